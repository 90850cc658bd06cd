#!/usr/bin/env bash
# One run of a station against its twin, in a network of its own if its caller gave it one. Prints
# "VERDICT<tab>the most probable cause".
#
#     tests/evidence/twin_run.sh BIN FOLDER SEED OUT
set -u
bin=$1 folder=$2 seed=$3 out=$4
ip link set lo up 2>/dev/null
"$bin/etalon-twin" "$folder/twin.yaml" --seed "$seed" --ready-file "$out.ready" \
    >"$out.twin" 2>&1 &
twin=$!
for _ in $(seq 300); do [ -e "$out.ready" ] && break; sleep 0.1; done
status=0
"$bin/etalon" qualify "$folder/station.yaml" --out "$out" --json >"$out.json" 2>"$out.log" || status=$?
kill $twin 2>/dev/null; wait $twin 2>/dev/null
[ $status -le 2 ] || { echo "ERROR	$(tail -n 1 "$out.log")"; exit 0; }
verdict=$(sed -n 's/^  "outcome": "\(.*\)",*$/\1/p' "$out.json" | head -n 1)
group=$(sed -n '/"causes": {/,$ s/^ *"text": "\(.*\)",*$/\1/p' "$out.json" | head -n 1)
printf '%s\t%s\n' "$verdict" "$group"
rm -rf "$out"
