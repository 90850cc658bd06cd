#!/usr/bin/env bash
# qualify-in-guest.sh BINARY_FOLDER v4l2|libcamera: the whole job with a USB camera that follows the
# simulated stage: `etalon qualify` must find it good. Runs in the guest.
set -euo pipefail
binaries=$1 backend=$2
qualify=$(cd "$(dirname "$0")" && pwd)/qualify

work=$(mktemp -d)
cp "$qualify"/* "$work"
mkfifo "$work/twin.log"
# libcamera cannot switch sharpening off, nor say that the exposure is what was asked for: the camera
# keeps what it powers up with, 15.7 ms and 3 dB, and the twin has less light.
if [ "$backend" = libcamera ]; then
    neutral="--sharpness 0"
    sed -i '/exposure_us/d' "$work/station.yaml"
    sed -i 's/nominal_exposure_us: .*/nominal_exposure_us: 27700/' "$work/twin.yaml"
fi
# shellcheck disable=SC2086  # none or two words
"$binaries/tests/vm/usb-camera" "$work/twin.yaml" ${neutral-} >"$work/twin.log" &
trap "kill $!; wait" EXIT
exec 3<"$work/twin.log"
read -r _ device <&3
read -r ready <&3
[ "$ready" = ready ]

case $backend in
    v4l2) uri=v4l2:$device ;;
    libcamera)
        export LD_PRELOAD=$binaries/tests/vm/libetalon_firmware_node.so LIBCAMERA_LOG_LEVELS='*:ERROR'
        uri=libcamera:virtual-1:1.0-1d6b:0102 ;;
esac
sed -i "s|CAMERA_URI|$uri|" "$work/station.yaml"
output=$("$binaries/etalon" qualify "$work/station.yaml" --out "$work/record") || {
    echo "exit code $?"
    grep -A 12 '"reasons"' "$work/record/run.json" || true
}
echo "$output"
grep -qx 'verdict PASS' <<<"$output"
