"""A browser that is driven: headless Chromium by ChromeDriver, in the words of W3C WebDriver
(https://www.w3.org/TR/webdriver2/), with Python's own library alone."""

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.request

ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # the standard's name of a reference
ENTER, TAB, SPACE = "\ue007", "\ue004", " "


def is_installed():
    return bool(shutil.which("chromedriver") and shutil.which("chromium"))


class Element:
    def __init__(self, browser, reference):
        self.browser, self.reference = browser, reference

    def _ask(self, method, what, body=None):
        return self.browser._ask(method, f"/element/{self.reference}/{what}", body)

    def click(self):
        self._ask("POST", "click", {})

    def type(self, text):
        self._ask("POST", "value", {"text": text})

    def clear(self):
        self._ask("POST", "clear", {})

    @property
    def text(self):
        return self._ask("GET", "text")

    @property
    def role(self):
        return self._ask("GET", "computedrole")

    @property
    def label(self):
        return self._ask("GET", "computedlabel")


class Browser:
    def __init__(self):
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE,
                                       stderr=subprocess.DEVNULL, text=True)
        for line in self.driver.stdout:
            if "successfully on port" in line:
                self.root = f"http://127.0.0.1:{line.split('on port')[1].strip(' .' + chr(10))}"
                break
        options = {"args": ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                            "--lang=en", f"--user-data-dir={self.profile.name}"]}
        self.session = ""
        made = self._ask("POST", "/session", {"capabilities": {"alwaysMatch": {
            "goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}}})
        self.session = f"/session/{made['sessionId']}"

    def close(self):
        try:
            self._ask("DELETE", "")
        finally:
            self.driver.terminate()
            self.driver.wait()
            self.profile.cleanup()

    def _ask(self, method, path, body=None):
        prefix = "" if path == "/session" else self.session
        request = urllib.request.Request(self.root + prefix + path, method=method,
                                         data=None if body is None else json.dumps(body).encode(),
                                         headers={"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=60) as reply:
                return json.load(reply)["value"]
        except urllib.error.HTTPError as error:
            raise RuntimeError(json.load(error)["value"]["message"].split("\n")[0]) from error

    def open(self, address):
        self._ask("POST", "/url", {"url": address})

    def run(self, script, *arguments):
        return self._ask("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def find(self, css):
        return Element(self, self._ask("POST", "/element", {"using": "css selector",
                                                            "value": css})[ELEMENT])

    def all(self, css):
        return [Element(self, one[ELEMENT]) for one in
                self._ask("POST", "/elements", {"using": "css selector", "value": css})]

    def active(self):
        return Element(self, self._ask("GET", "/element/active")[ELEMENT])

    def press(self, *keys):
        actions = [{"type": kind, "value": key} for key in keys for kind in ("keyDown", "keyUp")]
        self._ask("POST", "/actions", {"actions": [{"type": "key", "id": "keys",
                                                    "actions": actions}]})

    def width(self, width, height=1000):
        """Of what is laid out, also below the 500 px that a window has at least."""
        self._ask("POST", "/goog/cdp/execute", {
            "cmd": "Emulation.setDeviceMetricsOverride",
            "params": {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}})

    def picture(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self._ask("GET", "/screenshot")))

    def complaints(self):
        """What the console has said since it was asked last."""
        entries = self._ask("POST", "/se/log", {"type": "browser"})
        return [entry["message"] for entry in entries if entry["level"] == "SEVERE"]

    def wait(self, what, until, seconds=90):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                if found := until():
                    return found
            except RuntimeError:  # not there yet, or just replaced
                pass
            time.sleep(0.05)
        raise AssertionError(f"not within {seconds} s: {what}")
