#!/usr/bin/env bash
# Runs the commands of docs/tutorials as a reader would, each page in a folder of its own.
#     tests/tutorial_commands.sh BUILD_FOLDER
set -euo pipefail
source=$(cd "$(dirname "$0")/.." && pwd)
export PATH=$1:$PATH EXAMPLES=$source/examples
for page in "$source"/docs/tutorials/*.md; do
    scratch=$(mktemp -d)
    awk '/^```sh$/ {inside = 1; next} /^```$/ {inside = 0} inside' "$page" >"$scratch/commands.sh"
    [ -s "$scratch/commands.sh" ] || { echo "$page holds no commands"; exit 1; }
    (cd "$scratch" && bash -euxo pipefail commands.sh)
    rm -rf "$scratch"
done
