#!/usr/bin/env bash
# Builds the tsan preset and runs the unit tests under the thread sanitizer. A run over the real protocols:
#     cmake --build build/tsan --target etalon etalon-twin
#     TSAN_OPTIONS=suppressions=$PWD/scripts/thread-sanitizer.supp ETALON_BIN=build/tsan tests/evidence/soak.sh 10
set -euo pipefail
cd "$(dirname "$0")/.."
export TSAN_OPTIONS="suppressions=$PWD/scripts/thread-sanitizer.supp"
cmake --preset tsan >/dev/null
cmake --build build/tsan --target unit_tests
ctest --test-dir build/tsan -L unit --output-on-failure --no-tests=error -j "$(($(nproc) * 5))"
