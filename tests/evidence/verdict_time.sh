#!/usr/bin/env bash
# How long one waits: from the demo's last frame to its verdict, and for the operating
# characteristic of its plan. The machine should be otherwise idle.
#     tests/evidence/verdict_time.sh [build/release] [runs]
set -euo pipefail
cd "$(dirname "$0")/../.."
build=${1:-build/release} runs=${2:-200}
work=$(mktemp -d)
"$build/etalon-twin" examples/demo/twin.yaml >"$work/twin.log" 2>&1 &
twin=$!
trap 'kill $twin 2>/dev/null || true; wait $twin 2>/dev/null || true; rm -rf "$work"' EXIT
until grep -q '^twin ready' "$work/twin.log"; do kill -0 $twin && sleep 0.1; done

"$build/etalon" qualify examples/demo/station.yaml --out "$work/run" >/dev/null 2>&1
time_of() { sed -n "s/^{\"t\":\([0-9.]*\),\"event\":\"$1\".*/\1/p" "$work/run/events.jsonl" | tail -1; }
awk -v from="$(time_of pose)" -v to="$(time_of PASS)" \
    'BEGIN { printf "seconds from last frame to verdict: %.1f\n", to - from }'

start=$(date +%s.%N)
"$build/etalon" oc examples/demo/station.yaml --runs "$runs" >/dev/null 2>&1
awk -v runs="$runs" -v from="$start" -v to="$(date +%s.%N)" \
    'BEGIN { printf "oc --runs %d seconds: %.1f\n", runs, to - from }'
