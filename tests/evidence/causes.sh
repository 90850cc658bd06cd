#!/usr/bin/env bash
# Which cause is named: simulated runs of every kind of error (build/release/tests/evidence/causes),
# then one run each of the demo's station against a twin in which something is wrong, over the real
# protocols. Prints the tables of docs/causes.md. Exit 0 when every twin's cause is named.
#
#     tests/evidence/causes.sh [RUNS] [CASE...]
#
# RUNS of each kind and size, 50 where nothing is said; 0 leaves the simulated runs out.
set -euo pipefail
project=$(cd "$(dirname "$0")/../.." && pwd)
bin=${ETALON_BIN:-$project/build/release}
runs=${1:-50}
[ $# -eq 0 ] || shift
[ "$runs" -eq 0 ] || "$bin/tests/evidence/causes" "$runs"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
isolate=""
jobs=1
if unshare -n ip link set lo up 2>/dev/null; then
    isolate="unshare -n"
    jobs=$(nproc)
fi

# case | file of the twin that is edited | sed expression | what the cause must hold
cases=$(cat <<'CASES'
nothing|twin.yaml|/^seed:/s/7/7/|^$
aspect 0.3 %|true.yml|s/fy: 431.0/fy: 432.3/|^aspect of fx, fy$
focal length 0.5 %|true.yml|s/fx: 431.0, fy: 431.0/fx: 433.2, fy: 433.2/|focal length
k1 10 %|true.yml|s/k1: -0.286/k1: -0.315/|k1
k3, p1, p2|true.yml|s/p1: 0, p2: 0, k3: 0.112/p1: 6e-4, p2: -4e-4, k3: 0.16/|k3.* and p1 and p2
p1, p2|true.yml|s/p1: 0, p2: 0/p1: 6e-4, p2: -4e-4/|^p1.* and p2
sensor tilt 0.57 deg|true.yml|s/p1: 0,/tau_x: 0.01, p1: 0,/|^sensor tilt tau_x$
sensor tilt 0.29 deg|true.yml|s/p1: 0,/tau_y: 0.005, p1: 0,/|^sensor tilt tau_y$
thin prism|true.yml|s/p1: 0,/s1: 0.002, p1: 0,/|thin prism s1
c_x 2 px|true.yml|s/cx: 253.7/cx: 255.7/|c_x
stage scale y 0.1 %|twin.yaml|/^ *y: *{scale_ppm/s/scale_ppm: 0/scale_ppm: 1000/|^stage scale y$
periodic x 30 um, 5 mm|twin.yaml|/^ *x: *{scale_ppm/s/scale_ppm: 0/periodic_um: 30, period_mm: 5/|^x repeats with a period of .*5 mm
backlash z 200 um|twin.yaml|/^ *z: *{scale_ppm/s/backlash_um: 0/backlash_um: 200/|^backlash of z$
squareness xy 0.5 mrad|twin.yaml|/^ *y: *{scale_ppm/s/scale_ppm: 0/lean_urad: {x: 500}/|^stage squareness xy$
repeatability x 30 um|twin.yaml|/^ *x: *{scale_ppm/s/repeatability_um: 2/repeatability_um: 30/|^scatter of x$
marker 0.2 % larger|twin.yaml|s/5@80mm/5@80.16mm/|marker print size
focus at 600 mm|true.yml|s/focus_distance_mm: 1200/focus_distance_mm: 600/|^focus distance$
f/2.8|true.yml|s/f_number: 1.4/f_number: 2.8/|^f-number$
gain 12 e/DN|true.yml|s/gain_e_per_dn: 60/gain_e_per_dn: 12/|^noise$
Rec. 709 curve|true.yml|s/transfer: linear/transfer: rec709/|^tone curve$
background 0.9|twin.yaml|s/background: 0.6/background: 0.9/|^background$
black level 16|true.yml|s/black: 8 /black: 16 /|^black level$
false in position x|twin.yaml|0,/^  errors:/s/^  errors:/  faults: [{fault: false_in_position, axis: x, at: {move: 8}}]\n&/|^$
exposed twice as long|twin.yaml|s/nominal_exposure_us: 5000/nominal_exposure_us: 2500/|^overexposed$
CASES
)

prepare() {  # a copy of the demo with a case's error in the twin, ten times as fast
    cp -r "$project/examples/demo" "$1"
    cp "$1/camera.yml" "$1/true.yml"
    sed -i -E 's/(speed|speed_deg): ([0-9]+)/\1: \20/' "$1/twin.yaml" "$1/station.yaml"
    sed -i 's/calibration: camera.yml/calibration: true.yml/' "$1/twin.yaml"
    sed -i "$3" "$1/$2"
}

status=0
printf '| wrong in the twin | verdict | cause named | |\n|---|---|---|---|\n'
while IFS='|' read -r name file edit expected; do
    if [ $# -gt 0 ] && ! printf '%s\n' "$@" | grep -qxF "$name"; then continue; fi
    folder="$work/$(tr -c 'a-z0-9\n' _ <<<"$name")"
    prepare "$folder" "$file" "$edit"
    printf '%s\n' "$name" >"$folder/name"
    printf '%s\n' "$expected" >"$folder/expected"
done <<<"$cases"
find "$work" -mindepth 1 -maxdepth 1 -type d | sort | xargs -P "$jobs" -I{} sh -c \
    "$isolate bash '$project/tests/evidence/twin_run.sh' '$bin' {} 7 {}/record >{}/found"
for folder in $(find "$work" -mindepth 1 -maxdepth 1 -type d | sort); do
    cause=$(cut -f 2 "$folder/found")
    right=yes
    grep -Eq "$(cat "$folder/expected")" <<<"$cause" || { right=NO; status=1; }
    printf '| %s | %s | %s | %s |\n' "$(cat "$folder/name")" "$(cut -f 1 "$folder/found")" "$cause" "$right"
done
exit $status
