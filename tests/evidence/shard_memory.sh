#!/usr/bin/env bash
# shard_memory.sh [COUNT...]: peak memory of image sets and operating characteristics in shards over the
# number of poses and runs (1000 and 1000000 where nothing is said). A dry run: all but a few poses are
# behind the camera, which are read, tried, refused and listed as others are, without a file for each; and
# the merged runs are one run's row over and over. Prints a line a count, MiB.
set -euo pipefail
project=$(cd "$(dirname "$0")/../.." && pwd)
etalon=$(realpath "${ETALON_BIN:-$project/build/release}")/etalon
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$project/examples/study/webcam.yml" "$work"
cp -r "$project/examples/demo" "$work"
cd "$work"
sed -i 's/poses: 100/poses: 40/;s/repeats: 8/repeats: 2/;s/frames: 5/frames: 2/' demo/station.yaml

peak() {  # COMMAND...: MiB
    /usr/bin/time -f %M -o peak "$@" >out 2>err || { cat err >&2; exit 1; }
    awk '{printf "%.0f", $1 / 1024}' peak
}
oc=("$etalon" oc demo/station.yaml --error "constant pose offset")
"${oc[@]}" --runs 2 --shard 1/2 --out one-run >/dev/null 2>&1

printf '%10s %14s %14s %14s\n' count "render shard" "render merge" "oc merge"
[ $# -gt 0 ] || set -- 1000 1000000
for n in "$@"; do
    awk -v n="$n" 'BEGIN {
        print "rx,ry,rz,tx,ty,tz"
        for (i = 0; i < n; ++i) print "0.1,0.2,0.3,5,-7," (i % int(n / 4) < 2 ? 400 : -400)
    }' >poses.csv
    render=("$etalon" render --camera webcam.yml --marker apriltag:36h11:5@50mm --poses poses.csv)
    rm -rf part-* merged runs
    "${render[@]}" --shard 2/2 --out part-2 >/dev/null 2>&1
    shard=$(peak "${render[@]}" --shard 1/2 --out part-1)
    merge=$(peak "$etalon" render merge part-1 part-2 --out merged)
    mkdir runs
    sed "s/\"runs\": 2/\"runs\": $n/; s/^    2$/    1/" one-run/oc.json >runs/oc.json
    awk -v n="$n" 'NR == 1 {print} NR == 2 {sub(/^[0-9]*/, ""); for (i = 0; i < n; ++i) print i $0}' \
        one-run/results.csv >runs/results.csv
    printf '%10d %14s %14s %14s\n' "$n" "$shard" "$merge" "$(peak "$etalon" oc merge runs)"
done
