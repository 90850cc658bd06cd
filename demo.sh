#!/usr/bin/env bash
# The main job on a bare machine: installs what is missing, builds, and runs `etalon demo`: it starts
# the twin (a Modbus stage and a GigE Vision camera on 127.0.0.1), qualifies the camera against it,
# and says where the report is. Arguments go to the twin. Exit code: the verdict's (0 PASS, 1 FAIL,
# 2 INCONCLUSIVE) or 3, 4 for a fault.
set -euo pipefail
cd "$(dirname "$0")"
mkdir -p build/demo
. scripts/packages.sh

# shellcheck disable=SC2086
install_packages $build_packages
build_etalon etalon etalon-twin

echo "== qualifying a simulated camera"
exec build/release/etalon demo --out "build/demo/$(date +%Y%m%d-%H%M%S)-$$" -- "$@"
