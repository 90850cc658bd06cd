#!/usr/bin/env bash
# Runs tests of the Python module that was built.
#     tests/python_test.sh PYTHON BUILD_DIR TEST_FILES...
set -euo pipefail
python=$1
export PYTHONPATH=$(realpath "$2")/python PYTHONDONTWRITEBYTECODE=1 MPLCONFIGDIR=${TMPDIR:-/tmp}/etalon-matplotlib
shift 2
for package in numpy pytest; do
    "$python" -c "import $package" 2>/dev/null || { echo "skipped: python3-$package is missing"; exit 77; }
done
cd "$(dirname "$0")/python"
exec "$python" -m pytest -q -p no:cacheprovider -rs "$@"
