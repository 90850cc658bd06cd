#!/usr/bin/env bash
# A run as long as you like against the twin over the real protocols, with a fault of the link each 20 s
# that costs time and not the run, and packets lost all along: what a program could lose slowly. Every
# ten seconds memory, file descriptors and threads of both programs are read, and the log's time is
# compared with that of the file system. Prints a table of the first and the last fifth of the run. Exit 0
# when the run ends with PASS and nothing grows (memory by 16 MiB: a heap keeps the room of its highest peak).
#
#     tests/evidence/soak.sh [MINUTES]      60 where nothing is said, at most 64: a plan holds 2000 poses
set -euo pipefail
project=$(cd "$(dirname "$0")/../.." && pwd)
bin=$(realpath "${ETALON_BIN:-$project/build/release}")
minutes=${1:-60}
if [ -z "${ETALON_SOAKING:-}" ] && unshare -n ip link set lo up 2>/dev/null; then
    ETALON_SOAKING=yes exec unshare -n "$0" "$minutes"
fi
ip link set lo up 2>/dev/null || true
work=$(mktemp -d)
trap 'kill $(jobs -p) 2>/dev/null || true; rm -rf "$work"' EXIT

cp -r "$project/examples/demo" "$work/demo"
cd "$work/demo"
# So slow that a pose takes two seconds.
sed -i -E 's/(speed|speed_deg): ([0-9]+)0/\1: 14/' twin.yaml station.yaml
sed -i "s/poses: 100/poses: $((31 * minutes))/" station.yaml
faults=$(for ((s = 20; s < 60 * minutes; s += 20)); do
    case $((s / 20 % 6)) in
        0) echo "{fault: late_reply, at: {time_ms: ${s}000}, delay_ms: 400}" ;;
        1) echo "{fault: silence, at: {time_ms: ${s}000}}" ;;
        2) echo "{fault: garbage, at: {time_ms: ${s}000}}" ;;
        3) echo "{fault: wrong_id, at: {time_ms: ${s}000}}" ;;
        4) echo "{fault: slow_bytes, at: {time_ms: ${s}000}, delay_ms: 20}" ;;
        5) echo "{fault: reset, at: {time_ms: ${s}000}}" ;;
    esac
done | paste -sd,)
sed -i "0,/^  errors:/s/^  errors:/  faults: [$faults]\n&/;s/^  nominal_exposure_us/  packet_loss: 0.0005\n&/" twin.yaml

# One heap: with several, which threads that come and go leave half full, memory tells nothing.
export MALLOC_ARENA_MAX=1
"$bin/etalon-twin" twin.yaml --ready-file ready >twin.log 2>&1 &
twin=$!
for _ in $(seq 300); do [ -e ready ] && break; sleep 0.1; done
"$bin/etalon" qualify station.yaml --out record >out 2>&1 &
station=$!

held() {  # KiB, file descriptors and threads of a program
    awk '/^VmRSS/ {kib = $2} /^Threads/ {threads = $2} END {printf "%d ", kib}' "/proc/$1/status"
    printf '%s ' "$(ls "/proc/$1/fd" | wc -l)"
    awk '/^Threads/ {print $2}' "/proc/$1/status"
}
log=record/events.jsonl
while kill -0 $station 2>/dev/null && ! grep -q '"event":"axes stopped"' $log 2>/dev/null; do
    sleep 10
    [ -s $log ] || continue
    before=$(stat -c %.3Y $log)
    t=$(tail -n 1 $log | sed -n 's/^{"t":\([0-9.]*\),.*/\1/p')
    [ "$before" = "$(stat -c %.3Y $log)" ] && [ -n "$t" ] || continue
    echo "$(held $station) $(held $twin) $(grep -c '"event":"pose"' $log) $(awk "BEGIN {printf \"%.3f\", $before - $t}")"
done >samples 2>/dev/null
status=0
wait $station || status=$?
grep -E '^verdict' out || tail -n 3 out
grep -o '"reconnects":[0-9]*\|"missing_packets":[0-9]*\|"frames_rejected":[0-9]*' $log | tail -n 3 | paste -sd' '
awk -v status=$status '
    NF == 8 {line[++n] = $0}   # the last may be of a program that ends
    function means(from, to,   i, k, part) {
        for (k = 1; k <= 8; ++k) mean[k] = 0
        for (i = from; i <= to; ++i) { split(line[i], part); for (k = 1; k <= 8; ++k) mean[k] += part[k] / (to - from + 1) }
    }
    END {
        fifth = int(n / 5)
        if (fifth < 1) { print "too short"; exit 1 }
        means(fifth + 1, 2 * fifth); for (k = 1; k <= 8; ++k) first[k] = mean[k]
        means(n - fifth + 1, n)
        poses = mean[7] - first[7]
        printf "%-9s %12s %12s %14s %14s\n", "", "KiB, second", "fifth, last", "descriptors", "threads"
        printf "%-9s %12.0f %12.0f %6.1f %7.1f %6.1f %7.1f\n", "etalon", first[1], mean[1], first[2], mean[2], first[3], mean[3]
        printf "%-9s %12.0f %12.0f %6.1f %7.1f %6.1f %7.1f\n", "twin", first[4], mean[4], first[5], mean[5], first[6], mean[6]
        kib = (mean[1] - first[1]) / poses
        drift = mean[8] - first[8]
        printf "%d samples, %d poses between the fifths: %.1f KiB a pose, the clocks drift by %.3f s\n", n, poses, kib, drift
        bad = status != 0 || mean[1] - first[1] > 16384 || mean[4] - first[4] > 8192 || drift > 0.05 || drift < -0.05
        for (k = 2; k <= 6; ++k) if (k != 4 && (mean[k] - first[k] > 0.5)) bad = 1
        exit bad
    }' samples
