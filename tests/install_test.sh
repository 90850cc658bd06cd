#!/usr/bin/env bash
# Installs the build into a scratch folder; then a project of its own, examples/library/, is built
# there with find_package(etalon), and each of its programs does its work on what the others made.
#     tests/install_test.sh BUILD_DIR
set -euo pipefail
source=$(cd "$(dirname "$0")/.." && pwd)
scratch=$(mktemp -d)
twin=
trap '[ -z "$twin" ] || kill "$twin"; wait; rm -rf "$scratch"' EXIT
cmake --install "$1" --prefix "$scratch/prefix" >/dev/null
"$scratch/prefix/bin/etalon" --version

for script in bash-completion/completions/etalon zsh/vendor-completions/_etalon fish/vendor_completions.d/etalon.fish; do
    [ -s "$scratch/prefix/share/$script" ]
done
if command -v help2man >/dev/null; then
    grep -q 'marker is seen squarely\|rx,ry,rz,tx,ty,tz' "$scratch/prefix/share/man/man1/etalon-render.1"
fi

headers=$(find "$scratch/prefix/include" -name '*.h' | wc -l)
echo "$headers headers are installed (at most 100)"
[ "$headers" -le 100 ]

# Python's module, where the build has one.
for package in "$scratch"/prefix/lib/python3*/*-packages/etalon; do
    [ ! -e "$package" ] || ! /usr/bin/python3 -c 'import numpy' 2>/dev/null ||
        PYTHONPATH=$(dirname "$package") /usr/bin/python3 -c \
            'import etalon; print(etalon.__file__, etalon.Station(etalon.testing.demo / "station.yaml"))'
done

cmake -S "$source/examples/library" -B "$scratch/build" -G Ninja \
    -DCMAKE_PREFIX_PATH="$scratch/prefix" >/dev/null
cmake --build "$scratch/build"
cd "$scratch/build"

# expect TEXT COMMAND...: the command says it, whatever its exit code.
expect() {
    local text=$1 said
    shift
    said=$("$@") || true
    echo "$said"
    grep -q -- "$text" <<<"$said" || { echo "$1 did not say: $text" >&2; exit 1; }
}

camera=$source/examples/demo/camera.yml
tag=apriltag:36h11:5@80mm
./render "$camera" tag.png
expect 'marker at \(19\.9\|20\.0\)[0-9]* -\(9\.9\|10\.0\)[0-9]* \(399\|400\)\.' ./detect "$camera" $tag tag.png
expect 'rendering: [0-3]\..* [01]\.[0-9]* at the refined pose' ./compare "$camera" $tag tag.png

printf '%s\n' rx,ry,rz,tx,ty,tz 0.3,-0.2,0.1,-100,-60,400 -0.3,0.3,0,-120,-80,500 \
    0.2,0.4,-0.1,-90,-60,450 -0.2,-0.4,0.2,-60,-90,420 0.5,0.1,0.05,-100,-70,380 >poses.csv
"$scratch/prefix/bin/etalon" render --camera "$camera" --marker chessboard:9x6@25mm \
    --poses poses.csv --out boards >/dev/null
expect 'from 5 photos: 0\.0' ./calibrate calibrated.yml chessboard:9x6@25mm boards/*.png

# The main job, on a plan that is shorter than the demo's; only where the twin has a camera.
if [ -x "$scratch/prefix/bin/etalon-twin" ]; then
    cp "$source"/examples/demo/* .
    sed -i 's/poses: 100/poses: 40/; s/repeats: 8/repeats: 2/; s/frames: 5/frames: 2/' station.yaml
    "$scratch/prefix/bin/etalon-twin" twin.yaml --ready-file ready &
    twin=$!
    for _ in $(seq 100); do [ -e ready ] || sleep 0.1; done
    expect '^\(PASS\|INCONCLUSIVE\)' ./qualify station.yaml record
    [ -s record/report.html ]

    # The installed program finds the installed twin and examples: the twin answers.
    status=0
    "$scratch/prefix/bin/etalon" demo -- --no-such-option 2>refused || status=$?
    cat refused
    [ $status -eq 3 ] && grep -q no-such-option refused
fi
