#!/usr/bin/env bash
# Fuzzes with coverage: builds tests/fuzz/coverage with clang's sanitizers and runs each of its targets.
#
#     scripts/fuzz.sh SECONDS [TARGET...]      scripts/fuzz.sh 3600 own_files
#
# As many targets at a time as there are processors. Prints a table; exit code 1 when a target found
# something: its input is then in build/fuzz/findings/ and printed (base64 of gzip), and
# `build/sanitized/tests/fuzz/TARGET INPUT` repeats it. What was found worth trying is kept in
# build/fuzz/corpus/. 77: cannot run here, and why. ETALON_FUZZ_SEED: what the random numbers start
# from; else every run has its own.
set -euo pipefail
cd "$(dirname "$0")/.."
if [ $# -eq 0 ] || [ "$1" = --help ] || [ "$1" = -h ]; then
    sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0"
    exit 3
fi
export seconds=$1
shift

. scripts/packages.sh
if ! has_clang_sanitizers; then
    echo "skipped: no clang++ with libFuzzer here (packages clang and libclang-rt-dev)"
    exit 77
fi
mkdir -p build/fuzz/findings
build_etalon etalon etalon-twin
if ! { configure_sanitized &&
        cmake --build build/sanitized --target "${@:-fuzz_targets}"; } >build/fuzz/build.log 2>&1; then
    echo "The build failed:" >&2
    grep -E -A 5 'rror:|FAILED:|CMake Error' build/fuzz/build.log | head -n 40 >&2
    exit 1
fi

# Where a target begins: the inputs of its archive, of which each reaches edges that no other does, and
# files that lie elsewhere. New ones, in build/fuzz/corpus/TARGET, are added by hand: unpack, then
# cmake -E tar cf TARGET.zip --format=zip FILES.
seeds_of() {
    local unpacked=build/fuzz/seeds/$1
    rm -rf "$unpacked"
    mkdir -p "$unpacked"
    (cd "$unpacked" && cmake -E tar xf "$OLDPWD/tests/fuzz/corpus/$1.zip")
    echo "$unpacked"
    if [ "$1" = own_files ]; then
        echo examples/demo examples/study examples/every-key stage/profiles tests/vm/qualify
    fi
}

# Its dictionary: the words that the sources of its readers hold in quotes.
words_of() {
    local sources
    case $1 in
        own_files) sources="compare/qualification station/certify/certificate.cpp mocks/twin stage sim/marker/marker.cpp station/compare \
            station/setup study calib/files/camera_file.cpp calib/camera/camera_model.h core/geometry/units.h" ;;
        foreign_cameras) sources=calib/files ;;
        event_log) sources="capture/frame/frame_log.cpp core/image/image.cpp station/qualify/recorded_run.cpp station/record" ;;
        records) sources="station/history station/render/image_set.cpp study/study_results.cpp" ;;
        command_lines) sources="station sim/marker" ;;
        detector_answers) sources=study/external_detector.cpp ;;
        descriptions) sources=capture/genicam ;;
        *) return ;;
    esac
    # shellcheck disable=SC2086
    grep -rhoE '"[A-Za-z0-9_./,-]{2,30}"' $sources | sed 's/,[^"]*//' | grep -v '^""$' | sort -u
}

# What a finding says of itself, which the run keeps from the terminal, and its input.
describe_finding() {
    local found
    for found in "build/fuzz/findings/$1"-*; do
        timeout 60 "build/sanitized/tests/fuzz/$1" -timeout=20 "$found" || true
        echo "input $found: $(gzip -9cn "$found" | base64 -w 0)"
    done
}

# One line of the table, and below it the ends of what was found. The time is the processor's.
run_target() {
    local target=$1 log=build/fuzz/$1.log kept=build/fuzz/corpus/$1 status=0
    mkdir -p "$kept"
    words_of "$target" >"build/fuzz/$target.dict"
    local with_words=()
    [ ! -s "build/fuzz/$target.dict" ] || with_words=("-dict=build/fuzz/$target.dict")
    TIMEFORMAT='cpu %U %S'
    # shellcheck disable=SC2046
    { time "build/sanitized/tests/fuzz/$target" -seed="${ETALON_FUZZ_SEED:-0}" \
        -max_total_time="$seconds" -timeout=600 -rss_limit_mb=3000 -close_fd_mask=3 \
        -print_final_stats=1 "${with_words[@]}" \
        -artifact_prefix="build/fuzz/findings/$target-" "$kept" $(seeds_of "$target"); } \
        2>"$log" || status=$?
    [ "$status" -eq 0 ] || describe_finding "$target" >>"$log" 2>&1
    awk -v target="$target" -v status="$status" '
        match($0, / cov: [0-9]+/) { covered = substr($0, RSTART + 6, RLENGTH - 6) }
        /^stat::number_of_executed_units/ { runs = $2 }
        /^cpu / { cpu = $2 + $3 }
        END { printf "%-17s %11d %9d %8.0f  %s\n", target, runs, covered, cpu,
                     status == 0 ? "nothing" : "FINDING, see build/fuzz/" target ".log" }' "$log"
    [ "$status" -eq 0 ] || grep -E '^input |ERROR: |^SUMMARY|^    #[0-9] ' "$log" | tail -n 40
    return "$status"
}
export -f run_target describe_finding seeds_of words_of

# In memory where there is some (they need 0.1 MB): ext4 brings a file that is written again to the
# disk when it is closed, and beside three others `tables` got 9 % of a processor instead of 50 %.
TMPDIR=$(mktemp -d -p /dev/shm 2>/dev/null || mktemp -d)
export TMPDIR
trap 'rm -rf "$TMPDIR"' EXIT
if [ $# -eq 0 ]; then
    set -- tests/fuzz/coverage/*.cpp
    set -- "${@##*/}"
    set -- "${@%.cpp}"
fi
printf '%-17s %11s %9s %8s  %s\n' target executions "edges" "CPU s" findings
printf '%s\n' "$@" | xargs -P "$(nproc)" -I {} bash -c 'run_target {}' || exit 1
