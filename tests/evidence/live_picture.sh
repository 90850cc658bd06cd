#!/usr/bin/env bash
# What the live picture of the operator's page costs: a twin of a camera with a megapixel, one browser
# that looks, 20 s. Prints pictures per second and the share of one core that `etalon serve` takes.
# docs/serve.md has the figures.
#
#     [ETALON_BIN=build/release] tests/evidence/live_picture.sh
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
bin=${ETALON_BIN:-$root/build/release}
work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; wait; rm -rf "$work"' EXIT
cp "$root"/examples/demo/* "$work"
sed -i 's/width: 512, height: 384/width: 1280, height: 800/; s/pixel_pitch_um: 5.0/pixel_pitch_um: 2.0/
    s/fx: 431.0, fy: 431.0, cx: 253.7, cy: 194.2/fx: 1077.0, fy: 1077.0, cx: 637.7, cy: 401.2/
    s/focus_distance_mm: 1200/focus_distance_mm: 500/' "$work/camera.yml"

first_line() {  # of a program's output, when it is there
    until [ -s "$1" ]; do sleep 0.1; done
    head -n 1 "$1"
}
"$bin/etalon-twin" "$work/twin.yaml" >"$work/twin.log" 2>&1 &
first_line "$work/twin.log"
"$bin/etalon" serve "$work/station.yaml" --records "$work/runs" --port 0 >"$work/serve.log" 2>&1 &
server=$!
page=$(first_line "$work/serve.log" | cut -d' ' -f2)
python3 - "$page" $server <<'PYTHON'
import json, os, sys, threading, time, urllib.request
page, server = sys.argv[1], sys.argv[2]
ask = lambda path: json.load(urllib.request.urlopen(page + path))
def cpu_s():
    fields = open(f"/proc/{server}/stat").read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
urllib.request.urlopen(urllib.request.Request(page + "api/live/start", b'{"station": 0}', {
    "Content-Type": "application/json", "X-Etalon-Action": ask("api/session")["action_token"]}))
reader = urllib.request.urlopen(page + "api/live.mjpg")
threading.Thread(target=lambda: [None for _ in iter(lambda: reader.read(4096), b"")], daemon=True).start()
while not (ask("api/state")["live"] or {}).get("mean"):
    time.sleep(0.1)
begin, used = time.monotonic(), cpu_s()
time.sleep(20)
share = (cpu_s() - used) / (time.monotonic() - begin)
live = ask("api/state")["live"]
print(f"1280 x 800 px, {live['per_second']:.1f} pictures a second, marker seen: {live['marker_seen']}, "
      f"{100 * share:.0f} % of one core")
PYTHON
