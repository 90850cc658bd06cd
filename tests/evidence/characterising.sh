#!/usr/bin/env bash
# Every value that `etalon characterise` finds beside the truth and its U, from photographs that the
# reference integrator rendered (tests/station/calibrate/characterise_command_statistics_test.cpp has the scenes).
# Exit 0 when each is within its U. About two minutes of CPU time.
#
#     tests/evidence/characterising.sh
set -euo pipefail
project=$(cd "$(dirname "$0")/../.." && pwd)
exec "${ETALON_BIN:-$project/build/release}/tests/station_statistical_test" \
    --gtest_also_run_disabled_tests --gtest_filter='*ReferenceIntegrator'
