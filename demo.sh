#!/usr/bin/env bash
# The main job on a bare machine: installs what is missing, builds, starts the twin (a Modbus stage
# and a GigE Vision camera on 127.0.0.1), qualifies the camera against it, and says where the report
# is. Exit code: the verdict's (0 PASS, 1 FAIL, 2 INCONCLUSIVE) or 3, 4 for a fault.
set -euo pipefail
cd "$(dirname "$0")"
mkdir -p build/demo
. scripts/packages.sh

# shellcheck disable=SC2086
install_packages $build_packages
build_etalon etalon etalon-twin

record=build/demo/$(date +%Y%m%d-%H%M%S)-$$
twin_log=$record.twin.log

echo "== starting the twin (log: $twin_log)"
build/release/etalon-twin examples/demo/twin.yaml "$@" >"$twin_log" 2>&1 &
twin=$!
trap 'kill $twin 2>/dev/null || true; wait $twin 2>/dev/null || true' EXIT
for _ in $(seq 100); do
    grep -q '^twin ready' "$twin_log" && break
    if ! kill -0 $twin 2>/dev/null; then
        status=0; wait $twin || status=$?
        echo "The twin did not start:" >&2
        cat "$twin_log" >&2
        exit $status
    fi
    sleep 0.1
done

echo "== qualifying the camera"
status=0
build/release/etalon qualify examples/demo/station.yaml --out "$record" || status=$?
exit $status
