#!/usr/bin/env python3
"""The operator's page in headless Chromium, against the twin: the whole way from set-up to the
verdict, by keyboard alone, at three widths, with names for a screen reader, across a reload, a stop
and a browser that is killed. Exit code 77 where there is no Chromium.

    operator_page_test.py BUILD_FOLDER SOURCE_FOLDER [PICTURES_FOLDER]
"""

import json
import pathlib
import re
import subprocess
import sys
import tempfile
import time

sys.dont_write_bytecode = True
from webdriver import ENTER, SPACE, TAB, Browser, is_installed

BUILD, SOURCE = map(pathlib.Path, sys.argv[1:3])
PICTURES = pathlib.Path(sys.argv[3]) if len(sys.argv) > 3 else None
WIDTHS = (400, 800, 1600)
POSES = 32


def quick_station(folder):
    """The demo's, with fast axes and few poses: a run of some twenty seconds."""
    demo = SOURCE / "examples/demo"
    changes = ((r"speed: 400", "speed: 2000"), (r"speed_deg: 360", "speed_deg: 3000"),
               (r"poses: 100", f"poses: {POSES - 2}"), (r"repeats: 8", "repeats: 2"),
               (r"frames: 5", "frames: 2"), (r"settle_ms: 50", "settle_ms: 250"))
    for name in ("station.yaml", "twin.yaml"):
        text = (demo / name).read_text()
        for what, by in changes:
            text = re.sub(what, by, text)
        (folder / name).write_text(text)
    (folder / "cameras").mkdir()
    for name in ("camera.yml", "limits.yaml", "cameras/camera.yml"):
        text = (demo / pathlib.Path(name).name).read_text()
        (folder / name).write_text(re.sub(r"lens: .*\n", "", text))  # sharp: sooner rendered


class Programs:
    """The twin and the server, ended when the test is."""

    def __init__(self, folder):
        self.twin = self._begin("etalon-twin", folder / "twin.yaml")
        self._first_line(self.twin, "twin ready")
        self.server = self._begin("etalon", "serve", folder / "station.yaml", "--records",
                                  folder / "records", "--calibrations", folder / "cameras",
                                  "--port", "0")
        self.address = self._first_line(self.server, "page ").split()[1]

    @staticmethod
    def _begin(name, *arguments):
        return subprocess.Popen([BUILD / name, *arguments], stdout=subprocess.PIPE,
                                stderr=subprocess.STDOUT, text=True)

    @staticmethod
    def _first_line(program, begin):
        line = program.stdout.readline()
        assert line.startswith(begin), line
        return line

    def end(self):
        for program in (self.server, self.twin):
            program.terminate()
            program.wait()


def named(browser, view):
    """(role, name) of all that can be used or looked at; nothing when one was just replaced."""
    try:
        return [(element.role, element.label.strip()) for element in browser.all(
            f"header :is(a, button, select), #{view} :is(a, button, input, select, img, svg, "
            f"progress, meter, table)")]
    except RuntimeError:
        return []


def check_names(browser, view):
    """Everything that can be used, and every picture, has a name of its own."""
    names = browser.wait("the names", lambda: named(browser, view))
    for role, name in names:
        assert name and role not in ("", "none", "generic"), (view, role, name)
    buttons = [name for name in names if name[0] == "button"]
    assert len(set(buttons)) == len(buttons), (view, buttons)


def check_widths(browser, name):
    for width in WIDTHS:
        browser.width(width)
        size = browser.run("return [document.documentElement.scrollWidth, innerWidth]")
        assert size[0] <= size[1], (name, width, size)
        wide = browser.run("return [...document.querySelectorAll('main *')].filter(e => "
                           "e.getBoundingClientRect().right > innerWidth + 1).length")
        assert wide == 0, (name, width, wide)
        stop = browser.run("const r = document.getElementById('stop').getBoundingClientRect(); "
                           "return r.top >= 0 && r.bottom <= innerHeight && r.height >= 44")
        assert stop, (name, width, "Stop is not in view")
        if PICTURES:
            browser.picture(PICTURES / f"{name}-{width}.png")
    browser.width(1600)


def go_to(browser, text, most=60):
    """TAB until what has the focus is named so."""
    for _ in range(most):
        browser.press(TAB)
        if browser.active().label == text:
            return
    raise AssertionError(f"{text} is not reached by keyboard")


def position(browser, axis):
    row = browser.find(f"#setup [role=group][aria-label={axis}] .position")
    return float(row.text.split()[0])


def set_up(browser, address):
    browser.open(address + "#setup")
    browser.wait("the stage", lambda: browser.all("#setup .axis"))
    check_names(browser, "setup")
    check_widths(browser, "setup")
    # By keyboard: the name, home, and the question that is asked before.
    go_to(browser, "Your name")
    browser.active().type("Anna Berger")
    go_to(browser, "Home all axes")
    browser.press(ENTER)
    browser.wait("the question", lambda: browser.find("dialog[open]"))
    assert browser.find("dialog").role == "dialog"
    if browser.active().label != "Yes":
        go_to(browser, "Yes", 3)
    browser.press(SPACE)
    browser.wait("homed", lambda: browser.all("#setup .axis") and
                 all("not" not in e.text and "homed" in e.text
                     for e in browser.all("#setup .told")))
    browser.wait("rest", lambda: browser.find("#status").text.startswith("This page moves nothing"))
    before = position(browser, "x")
    browser.find("#setup button[aria-label='x: 1 mm ahead']").click()
    browser.wait("the jog", lambda: abs(position(browser, "x") - before - 1) < 0.02)
    browser.find("[data-part=picture] button").click()
    browser.wait("a picture", lambda: browser.run(
        "return document.querySelector('[data-part=picture] img')?.naturalWidth > 0"))
    browser.wait("its figures", lambda: browser.all("[data-part=figures] dd"))
    check_widths(browser, "setup-live")
    [b for b in browser.all("[data-part=picture] button") if b.text == "Hide"][0].click()
    browser.wait("hidden", lambda: not browser.all("[data-part=picture] img"))


def whatever_is_kept(browser, address):
    """What other pages or versions left in the browser's storage does not empty the page."""
    for station, language in (("NaN", "xx"), ("-1", "constructor"), ("0.5", ""), ("99", "NaN")):
        browser.run(f"localStorage.station = '{station}'; localStorage.language = '{language}'")
        browser.open("about:blank")
        browser.open(address)
        browser.wait("the form", lambda: browser.find("#run input[name=serial]"))
        browser.open(address + "#setup")
        browser.wait("the stage", lambda: browser.all("#setup .axis"))
    browser.run("localStorage.removeItem('station'); localStorage.removeItem('language')")
    browser.open("about:blank")


def start_by_keyboard(browser, address):
    browser.open(address)
    browser.wait("the form", lambda: browser.find("#run input[name=serial]"))
    check_names(browser, "run")
    check_widths(browser, "run-new")
    browser.press(TAB)
    assert browser.active().label == "Stop every axis and what goes on", browser.active().label
    go_to(browser, "Serial number of the camera")
    browser.active().type("TWIN")
    go_to(browser, "Start")
    browser.press(ENTER)
    browser.wait("poses", lambda: len(browser.all("#run circle.seen")) >= 6)


def stop_and_go_on(browser, address):
    visited = len(browser.all("#run circle.seen"))
    browser.open("about:blank")  # the page goes away, and comes back
    browser.open(address)
    browser.wait("the same run", lambda: len(browser.all("#run circle.seen")) >= visited)
    browser.find("#stop").click()
    browser.wait("the stop", lambda: browser.find(".verdict .word").text == "STOPPED")
    browser.wait("its confirmation", lambda: "confirms" in browser.find("#status").text)
    check_names(browser, "run")
    [b for b in browser.all("#run button") if b.text == "Go on"][0].click()
    browser.wait("poses", lambda: len(browser.all("#run circle.seen")) > visited)
    check_names(browser, "run")
    check_widths(browser, "run-going")


def verdict(browser, address, records):
    browser.open(address)
    browser.wait("the verdict", lambda: browser.find(".verdict .word"), 240)
    run = json.loads(next(records.glob("*/run.json")).read_text())
    assert browser.find(".verdict .word").text == run["outcome"], run["outcome"]
    assert run["outcome"] in ("PASS", "INCONCLUSIVE"), run["outcome"]
    assert run["poses_visited"] == POSES and len(run["sessions"]) == 2, run["poses_visited"]
    assert {s["operator"] for s in run["sessions"]} == {"Anna Berger"}
    check_names(browser, "run")
    check_widths(browser, "run-verdict")
    report = browser.run("return document.querySelector('.verdict a').href")
    browser.open(report)
    browser.wait("the report", lambda: run["outcome"] in browser.find(".verdict").text)


def fleet_in_german(browser, address):
    browser.open(address + "#fleet")
    browser.wait("runs", lambda: browser.all("#fleet tbody tr"))
    browser.run("const s = document.querySelector('#fleet select'); s.value = 'TWIN';"
                "s.dispatchEvent(new Event('change'))")
    browser.wait("a chart", lambda: browser.all("#fleet svg"))
    check_names(browser, "fleet")
    check_widths(browser, "fleet")
    browser.run("const s = document.getElementById('language'); s.value = 'de';"
                "s.dispatchEvent(new Event('change'))")
    browser.wait("German", lambda: browser.find("#stop").text == "STOPP")
    for view in ("setup", "run", "fleet"):
        browser.open(address + "#" + view)
        time.sleep(0.3)  # whatever is drawn by then
        text = browser.find("body").text
        assert "undefined" not in text and "{" not in text, text
        check_widths(browser, f"{view}-de")


def main():
    if not is_installed():
        print("chromium and chromedriver (Debian: chromium, chromium-driver) are not here: skipped")
        return 77
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        quick_station(folder)
        programs = Programs(folder)
        browser = Browser()
        try:
            set_up(browser, programs.address)
            whatever_is_kept(browser, programs.address)
            start_by_keyboard(browser, programs.address)
            stop_and_go_on(browser, programs.address)
            complaints = browser.complaints()
            browser.close()  # in mid-run
            browser = Browser()
            verdict(browser, programs.address, folder / "records")
            fleet_in_german(browser, programs.address)
            complaints += browser.complaints()
            assert not complaints, complaints
        except (AssertionError, RuntimeError):
            print("the page said:\n" + browser.find("body").text)
            if PICTURES:
                browser.picture(PICTURES / "failed.png")
            raise
        finally:
            browser.close()
            programs.end()
    print(f"from set-up to the verdict at {WIDTHS} px, {time.monotonic() - begun:.0f} s")
    return 0


sys.exit(main())
