#!/usr/bin/env bash
# Makes the Debian packages of the committed state in build/package: libetalon0, libetalon-dev,
# etalon, python3-etalon, etalon-doc. Says what lintian says about them, and their sizes. Needs
# Debian 12 or newer and 2 GB; takes 8 minutes on two cores, one when ccache knows everything.
#
#     scripts/package.sh                  make them
#     scripts/package.sh --reproducible   make them twice, in two folders; exit 1 if a byte differs
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/packages.sh
mkdir -p build/package
# shellcheck disable=SC2086
install_packages $build_packages $package_packages

# debhelper gives the build a home folder of its own: the compiler cache stays the user's.
CCACHE_DIR=${CCACHE_DIR:-$(ccache --get-config cache_dir)}
export CCACHE_DIR

commit=$(git rev-parse HEAD)   # of both builds, whatever is committed meanwhile
# make_packages FOLDER: its packages in FOLDER, by way of FOLDER/etalon.
make_packages() {
    rm -rf "$1"
    mkdir -p "$1/etalon"
    git archive "$commit" | tar -x -C "$1/etalon"
    (cd "$1/etalon" && dpkg-buildpackage --build=binary --no-sign) >"$1/build.log" 2>&1 || {
        tail -n 40 "$1/build.log" >&2
        return 4
    }
}

echo "== building (log: build/package/build.log)"
begin=$SECONDS
make_packages build/package
printf '%d s\n' $((SECONDS - begin))
(cd build/package && ls -l --block-size=K *.deb | awk '{print $5, $9}' && sha256sum *.deb >SHA256SUMS)
echo "== lintian"
lintian --fail-on error --tag-display-limit 0 build/package/*.changes

if [ "${1:-}" = --reproducible ]; then
    echo "== building again, elsewhere"
    again=$(mktemp -d)
    trap 'rm -rf "$again"' EXIT
    # Compiled again: what the cache holds would only be compared with itself.
    CCACHE_RECACHE=1 make_packages "$again/in-another-folder"
    (cd "$again/in-another-folder" && sha256sum -c "$OLDPWD/build/package/SHA256SUMS")
fi
