#!/usr/bin/env bash
# study_cost.sh [POSES...]: what a study with ArUco and AprilTag costs: CPU time a pose, shares of
# rendering and of all that is neither rendering nor detecting, peak memory, at 100, 1000 and 10 000
# poses (or the given numbers); and the time of two shards side by side against one process with one
# thread. ETALON: the program (build/release/etalon).
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
etalon=${ETALON:-$root/build/release/etalon}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$root/examples/study/published-camera.yml" "$work"

study() {   # POSES: the published volume for two detectors
    sed -e "s/count: .*/count: $1/" -e '/name: /d' "$root/examples/study/published.yaml"
    echo '  - {detector: aruco, marker: "aruco:4X4_50:7@50mm"}'
    echo '  - {detector: apriltag, marker: "apriltag:36h11:5@50mm"}'
}
for poses in "${@:-100 1000 10000}"; do
    for count in $poses; do
        study "$count" >"$work/study-$count.yaml"
        "$etalon" study "$work/study-$count.yaml" --out "$work/out-$count" 2>/dev/null |
            grep -A 1 'CPU time a pose'
    done
done

study 2000 >"$work/study.yaml"
seconds() { local start; start=$(date +%s%N); "$@"; echo "$((($(date +%s%N) - start) / 1000000))"; }
whole() { taskset -c 0 "$etalon" study "$work/study.yaml" --out "$work/whole" >/dev/null 2>&1; }
halves() {
    taskset -c 0 "$etalon" study "$work/study.yaml" --shard 1/2 --out "$work/1" >/dev/null 2>&1 &
    taskset -c 1 "$etalon" study "$work/study.yaml" --shard 2/2 --out "$work/2" >/dev/null 2>&1
    wait
}
one=$(seconds whole) two=$(seconds halves)
echo "2000 poses on one core: $one ms; two shards side by side: $two ms, $((100 * two / one)) % (50 would be ideal)"
