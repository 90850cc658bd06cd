#!/usr/bin/env bash
# Builds the tsan preset and runs the unit tests under the thread sanitizer.
set -euo pipefail
cd "$(dirname "$0")/.."
cmake --preset tsan >/dev/null
cmake --build build/tsan --target unit_tests
ctest --test-dir build/tsan -L unit --output-on-failure --no-tests=error -j "$(($(nproc) * 4))"
