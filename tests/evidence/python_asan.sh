#!/usr/bin/env bash
# The tests of the Python module under the address and undefined-behaviour sanitizers, which Python's
# own program does not have: they are loaded before it. Leaks are not looked for, as Python keeps its own
# until the end; memory that grows is (tests/python/test_render.py). Half an hour of building.
#     tests/evidence/python_asan.sh [PYTEST ARGUMENTS]
set -euo pipefail
cd "$(dirname "$0")/../.."
cmake --preset asan-ubsan >/dev/null
cmake --build build/asan-ubsan --target etalon_python >build/asan-python.log 2>&1 ||
    { tail -n 40 build/asan-python.log; exit 1; }
LD_PRELOAD="$(g++ -print-file-name=libasan.so) $(g++ -print-file-name=libubsan.so) $(g++ -print-file-name=libstdc++.so)"
export LD_PRELOAD ASAN_OPTIONS=detect_leaks=0:detect_odr_violation=0 UBSAN_OPTIONS=print_stacktrace=1
tests/python_test.sh /usr/bin/python3 build/asan-ubsan -k 'not memory and not copied' "$@"
