#!/usr/bin/env bash
# Prints the 30 slowest test cases of ctest's last run with their seconds: a case by GoogleTest's own
# time, and any other test by ctest's.
#
#     scripts/slowest-tests.sh [BUILD_FOLDER]          default: build/release
set -euo pipefail
cd "$(dirname "$0")/.."
log=${1:-build/release}/Testing/Temporary/LastTest.log
echo "== the 30 slowest tests, in seconds"
awk '
    match($0, /^[0-9]+\/[0-9]+ Testing: /) { name = substr($0, RLENGTH + 1); has_cases = 0 }
    /^\[ *(OK|FAILED) *\] .* \([0-9]+ ms\)$/ {
        has_cases = 1
        ms = substr($(NF - 1), 2)
        sub(/^\[ *[A-Z]+ *\] /, "")
        sub(/ \([0-9]+ ms\)$/, "")
        printf "%8.1f  %s\n", ms / 1000, $0
    }
    /^Test time = / && !has_cases { printf "%8.1f  %s\n", $4, name }' "$log" |
    sort -rn | awk 'NR <= 30'
