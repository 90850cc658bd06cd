#!/usr/bin/env bash
# How often the demo's plan and limits give the right verdict: runs the whole station against the
# twin over the real protocols, with nothing wrong and with one error injected, each for a number of
# seeds of the twin's noise, and prints a table. Exit 0 when every row keeps its promise.
#
#     tests/evidence/verdicts.sh [SEEDS] [CASE...]
#
# SEEDS defaults to 20 (half an hour on two cores); cases default to all:
#     true         camera and stage as declared         PASS, at most one run in 20 otherwise
#     focal        focal length 0.5 % off               FAIL in the same share, group named
#     k1           k1 10 % off                          FAIL in the same share, group named
#     scale-x, -y, -z   stage scale 0.2 % off           never PASS
#     reference    true, frames from the reference integrator (one seed): as `true`
#     reference-focal, reference-k1                     the same with the error: as above
#     wide, wide-focal, wide-k1   before a fisheye of 190 degrees: as `true`, `focal` and `k1`
# A FAIL counts where the error that was put in is among the causes that are named.
# Each run has a network namespace of its own where that is permitted, so that all cores work.
set -euo pipefail
project=$(cd "$(dirname "$0")/../.." && pwd)
bin=${ETALON_BIN:-$project/build/release}
seeds=${1:-20}
[ $# -eq 0 ] || shift
[ $# -gt 0 ] || set -- true focal k1 scale-x scale-y scale-z reference reference-focal reference-k1 \
    wide wide-focal wide-k1
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

isolate=""
jobs=1
if unshare -n ip link set lo up 2>/dev/null; then
    isolate="unshare -n"
    jobs=$(nproc)
fi

edit_of() {  # the sed expression that injects a case's error into twin.yaml
    case $1 in
        true | wide) echo '' ;;
        focal) echo 's/focal_length_percent: 0/focal_length_percent: 0.5/' ;;
        k1) echo 's/k1_percent: 0/k1_percent: 10/' ;;
        scale-[xyz]) echo "/^ *${1#scale-}: *{scale_ppm/s/scale_ppm: 0/scale_ppm: 2000/" ;;
        reference) echo 's/method: auto/method: reference/' ;;
        reference-*) echo "$(edit_of reference);$(edit_of "${1#reference-}")" ;;
        wide-*) edit_of "${1#wide-}" ;;
        *) echo "unknown case $1" >&2; return 3 ;;
    esac
}

expected_of() {
    case $1 in
        true | reference | wide) echo PASS ;;
        focal | k1 | *-focal | *-k1) echo FAIL ;;
        *) echo 'not PASS' ;;
    esac
}

cause_of() {
    case $1 in
        *focal) echo 'focal length' ;;
        *k1) echo 'k1' ;;
    esac
}

# The demo's stage before a fisheye of 190 degrees: the marker is 15 to 65 degrees off its axis.
widen() {
    cat >"$1/camera.yml" <<'END'
etalon: camera/1
serial: "TWIN"
image: {width: 800, height: 600}
projection: equidistant
intrinsics: {fx: 226.0, fy: 226.0, cx: 395.7, cy: 304.2}
distortion: {k1: 0.031, k2: -0.014, k3: 0.0021, k7: -0.0002}
sensor: {pixel_pitch_um: 5.0, bits: 8, transfer: linear, black: 8, gain_e_per_dn: 60, read_noise_e: 10}
lens: {f_number: 1.4, focus_distance_mm: 400, wavelength_nm: 550}
END
    local aside='translation_mm: [215, -51, 272]}'
    sed -i -e "s/^camera_mount: .*/camera_mount: {rotation_deg: [9, 38, 0], $aside/" \
        -e 's/  x: \[-120, 120\]/  x: [-115, 115]/' -e 's/  z: \[-150, 150\]/  z: [-75, 110]/' "$1/station.yaml"
    aside='translation_mm: [218, -55, 277]}'
    sed -i -e "s/camera_from_base: .*/camera_from_base: {rotation_deg: [9.7, 37.1, 0.8], $aside/" "$1/twin.yaml"
}

status=0
printf '%-16s %-9s %5s %5s %5s %6s   %s\n' case expected PASS FAIL INCON. ERROR 'group named (runs)'
for name in "$@"; do
    cp -r "$project/examples/demo" "$work/$name"
    # A stage ten times as fast: travel is the longest part of a run and changes no figure of it.
    sed -i -E 's/(speed|speed_deg): ([0-9]+)/\1: \20/' "$work/$name/twin.yaml" "$work/$name/station.yaml"
    case $name in wide*) widen "$work/$name" ;; esac
    cp "$work/$name/twin.yaml" "$work/$name/twin-before.yaml"
    sed -i "$(edit_of "$name")" "$work/$name/twin.yaml"
    if [ -n "$(edit_of "$name")" ] && cmp -s "$work/$name/twin-before.yaml" "$work/$name/twin.yaml"; then
        echo "the edit of case $name changed nothing in twin.yaml" >&2
        exit 3
    fi
    runs=$seeds
    case $name in reference*) runs=1 ;; esac
    seq "$runs" | xargs -P "$jobs" -I{} $isolate bash "$project/tests/evidence/twin_run.sh" "$bin" "$work/$name" {} \
        "$work/$name-{}" >"$work/$name.tsv"
    count() { cut -f 1 "$work/$name.tsv" | grep -cx "$1" || true; }
    pass=$(count PASS) fail=$(count FAIL)
    groups=$(cut -f 2 "$work/$name.tsv" | grep . | sort | uniq -c | sort -rn |
        sed 's/^ *\([0-9]*\) \(.*\)/\2 (\1)/' | paste -sd ';' || true)
    printf '%-16s %-9s %5d %5d %5d %6d   %s\n' "$name" "$(expected_of "$name")" "$pass" "$fail" \
        "$(count INCONCLUSIVE)" "$(count ERROR)" "$groups"
    grep '^ERROR' "$work/$name.tsv" >&2 || true
    allowed=$((runs / 20))
    case $(expected_of "$name") in
        PASS) [ "$pass" -ge $((runs - allowed)) ] || status=1 ;;
        FAIL)
            named=$(grep '^FAIL' "$work/$name.tsv" | grep -c "$(cause_of "$name")" || true)
            [ "$named" -ge $((runs - allowed)) ] || status=1
            ;;
        *) [ "$pass" -eq 0 ] && [ "$(count ERROR)" -eq 0 ] || status=1 ;;
    esac
done
[ $status -eq 0 ] && echo "every case keeps its promise" || echo "NOT every case keeps its promise"
exit $status
