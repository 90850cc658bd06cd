#!/usr/bin/env bash
# Runs clang-tidy with the project's checks (.clang-tidy) over every source of the dev preset, or
# over the files given. Needs clang-tidy; takes some ten minutes for everything.
set -euo pipefail
cd "$(dirname "$0")/.."
# A precompiled header of g++ is unreadable to clang: a build tree without one.
cmake -S . -B build/tidy -G Ninja -DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON >/dev/null
cmake --build build/tidy --target etalon_core >/dev/null   # the generated headers
if [ $# -eq 0 ]; then
    mapfile -t files < <(git ls-files '*.cpp' | grep -v '^tests/')
    set -- "${files[@]}"
fi
printf '%s\n' "$@" | xargs -P "$(nproc)" -n 4 clang-tidy -p build/tidy --quiet
