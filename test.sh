#!/usr/bin/env bash
# Installs what is missing, builds the release preset, runs its tests and says which took longest.
#
#     ./test.sh [--all] [CTEST ARGUMENTS]      ./test.sh -L sim    ./test.sh -R Stage
#
# Without --all: what guards every day's work; it leaves out the labels statistical (many renders or
# runs each, tolerances derived for their size), vm (two virtual machines with real camera drivers)
# and evidence (whole runs that are repeated, killed or sent to a cluster, and ten seconds of fuzzing
# for each target of scripts/fuzz.sh). --all: everything that this machine can run. Labels are these,
# unit, loopback, photo and install, and the module: -L sim/tiles. What cannot run here says skipped
# and why. Times: README.md.
set -euo pipefail
cd "$(dirname "$0")"
if [[ " $* " == *" --help "* || " $* " == *" -h "* ]]; then
    sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0"
    exit 0
fi
chosen=(-LE '^(statistical|vm|evidence)' -E '_NOT_BUILT$')   # which these are then
target=everyday_tests
if [ "${1:-}" = --all ]; then
    chosen=()
    target=all
    shift
fi
mkdir -p build
. scripts/packages.sh

# shellcheck disable=SC2086
install_packages $build_packages $test_packages
if [ "$target" = all ]; then
    # shellcheck disable=SC2086
    install_packages $all_test_packages
fi

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

build_etalon "$target"
echo "== testing"
status=0
ctest --test-dir build/release --output-on-failure --no-tests=error -j "$(($(nproc) * 5))" \
    "${chosen[@]}" "$@" || status=$?
scripts/slowest-tests.sh
exit "$status"
