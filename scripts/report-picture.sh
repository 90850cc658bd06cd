#!/usr/bin/env bash
# Makes docs/report.png again: the top of a report whose camera has an error, so that it has a cause to
# name. Runs the demo with a focal length that is off by 0.5 %. Needs chromium; two minutes.
#     scripts/report-picture.sh [BUILD_FOLDER]          default: build/release
set -euo pipefail
cd "$(dirname "$0")/.."
build=${1:-build/release}
command -v chromium >/dev/null || { echo "chromium is missing: apt-get install chromium" >&2; exit 3; }
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cp -r examples/demo "$scratch/station"
sed -i 's/focal_length_percent: 0,/focal_length_percent: 0.5,/' "$scratch/station/twin.yaml"
"$build"/etalon qualify "$scratch/station/station.yaml" --twin "$scratch/station/twin.yaml" \
    --out "$scratch/record" || [ $? -eq 1 ]
chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --window-size=1160,1040 \
    --user-data-dir="$scratch/browser" --screenshot="$PWD/docs/report.png" \
    "file://$scratch/record/report.html" 2>/dev/null
