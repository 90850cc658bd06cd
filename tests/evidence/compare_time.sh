#!/usr/bin/env bash
# compare_time.sh: what `etalon compare` costs, in CPU time of the whole program: photographs of a
# chessboard that fills most of the image, rendered with noise, by size and by camera model.
# ETALON: the program (build/release/etalon).
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd)
etalon=${ETALON:-$root/build/release/etalon}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
TIMEFORMAT='%U %S'

standard='k1: -0.21, k2: 0.06, p1: 4e-4, p2: -3e-4, k3: -0.008'
rational="$standard, k4: 0.3, k5: -0.05, k6: 0.01"
tilted="$rational, s1: 1e-4, s2: -5e-5, s3: 8e-5, s4: 2e-5, tau_x: 0.008, tau_y: -0.006"

camera() {  # WIDTH HEIGHT DISTORTION
    cat <<YAML
etalon: camera/1
image: {width: $1, height: $2}
intrinsics: {fx: $(($1 * 11 / 10)), fy: $(($1 * 11 / 10)), cx: $(($1 / 2 + 3)), cy: $(($2 / 2 - 2))}
distortion: {$3}
sensor: {pixel_pitch_um: 3, bits: 8, gain_e_per_dn: 40, read_noise_e: 20}
YAML
}
printf '%-12s %-10s %6s\n' size model 'CPU s'
for width in 640 1280 2560 4096; do
    height=$((width * 3 / 4))
    for model in standard rational tilted; do
        camera "$width" "$height" "${!model}" >"$work/camera.yml"
        "$etalon" render --camera "$work/camera.yml" --marker chessboard:9x6@25mm --exposure 0.85 \
            --pose 0.25,-0.18,0.04,-98,-62,290 --noise-seed 7 --out "$work/photo.png" >/dev/null
        { time "$etalon" compare --camera "$work/camera.yml" --board 9x6 --square-mm 25 \
            --out "$work/out" "$work/photo.png" >/dev/null 2>&1; } 2>"$work/time"
        printf '%-12s %-10s %6s\n' "${width}x$height" "$model" \
            "$(awk '{printf "%.1f", $1 + $2}' "$work/time")"
    done
done
