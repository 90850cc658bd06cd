#!/usr/bin/env bash
# Installs what is missing, builds the release preset, and runs every test that this machine can
# run. Arguments go to ctest: ./test.sh -L unit, ./test.sh -R Stage.
set -euo pipefail
cd "$(dirname "$0")"
mkdir -p build
. scripts/packages.sh

# shellcheck disable=SC2086
install_packages $build_packages $test_packages

# The real photographs are the documentation of a Debian package. Slim images leave documentation
# out when they install a package, so it is unpacked here instead.
if [ ! -e build/photos/left01.jpg ]; then
    echo "== fetching the photographs (package opencv-doc)"
    mkdir -p build/photos
    download=$(mktemp -d)
    if (cd "$download" && apt-get -q download opencv-doc >/dev/null 2>&1 &&
            dpkg-deb -x opencv-doc_*.deb .); then
        cp "$download"/usr/share/doc/opencv-doc/examples/data/{left,right}[0-9][0-9].jpg \
           "$download"/usr/share/doc/opencv-doc/examples/data/left_intrinsics.yml build/photos/
    else
        echo "   not available: the tests that need them will say 'skipped'"
    fi
    rm -rf "$download"
fi

build_etalon all
echo "== testing"
ctest --test-dir build/release --output-on-failure --no-tests=error -j "$(nproc)" "$@"
