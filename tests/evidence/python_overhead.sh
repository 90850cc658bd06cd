#!/usr/bin/env bash
# Prints what calls cost in C++ and from Python, side by side, by turns on one core: the best times, ms.
#     tests/evidence/python_overhead.sh [BUILD_DIR] [PYTHON]
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
build=${1:-$root/build/release}
python=${2:-/usr/bin/python3}
camera=$root/examples/demo/camera.yml
here=$(mktemp -d)
trap 'rm -rf "$here"' EXIT
export PYTHONPATH=$build/python PYTHONDONTWRITEBYTECODE=1
for _ in 1 2 3; do
    taskset -c 0 "$build/tests/evidence/python_overhead" "$camera" >>"$here/cpp"
    taskset -c 0 "$python" "$root/tests/evidence/python_overhead.py" "$camera" >>"$here/python"
done
awk -F'\t' '
    FNR == 1 { file++ }
    { if (!((file, $1) in best) || $2 < best[file, $1]) best[file, $1] = $2
      if (file == 1 && !seen[$1]++) names[++count] = $1 }
    END {
        printf "%-22s %12s %12s %8s\n", "", "C++, ms", "Python, ms", "ratio"
        for (i = 1; i <= count; i++)
            printf "%-22s %12.4f %12.4f %8.2f\n", names[i], best[1, names[i]], best[2, names[i]],
                   best[2, names[i]] / best[1, names[i]]
    }' "$here/cpp" "$here/python"
