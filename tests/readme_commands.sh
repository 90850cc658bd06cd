#!/usr/bin/env bash
# Runs the commands of README.md as a reader would, in a scratch folder that sees the build; the two
# top-level scripts are left to CI itself. Exit 77 (skipped) where the photographs are missing.
set -euo pipefail
project=$1
[ -e "$project/build/photos/left01.jpg" ] || { echo "no photographs in build/photos"; exit 77; }

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
mkdir build
ln -s "$project/build/photos" build/photos
ln -s "$project/examples" examples
mkdir -p build/release
for program in etalon etalon-twin; do
    ln -s "$2/$program" "build/release/$program"
done

awk '/^```sh$/ {inside = 1; next} /^```$/ {inside = 0} inside && !/^\.\/(demo|test)\.sh/' \
    "$project/README.md" >commands.sh
[ -s commands.sh ] || { echo "README.md holds no commands"; exit 1; }
bash -euxo pipefail commands.sh
