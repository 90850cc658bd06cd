#!/usr/bin/env bash
# guest-kernel.sh FOLDER: the distribution's stock kernel, unpacked under FOLDER and never installed.
# Prints the folder of the unpacked packages and the kernel's version, separated by a space.
#
# Which package that is, apt says: the meta package depends on the current one. What was unpacked
# once is used again; without a network, so is the newest that is there. Exit 77 with the reason
# when there is no kernel to be had.
set -euo pipefail

skip() {
    echo "skipped: $*" >&2
    exit 77
}

store=$1
meta_packages="linux-image-amd64 linux-image-generic"   # Debian's, Ubuntu's
mkdir -p "$store"
exec 9>"$store/lock"
flock 9

# The machine's package lists; if they were thrown away (slim images), lists of our own.
apt_options=()
if ! apt-cache show linux-image-amd64 >/dev/null 2>&1 &&
        ! apt-cache show linux-image-generic >/dev/null 2>&1; then
    mkdir -p "$store/lists/partial"
    apt_options=(-o "Dir::State::Lists=$store/lists" -o "Dir::Cache::pkgcache=" -o "Dir::Cache::srcpkgcache=")
    apt-get -q "${apt_options[@]}" update >/dev/null 2>&1 || true
fi

# The image, and the packages with its modules where the distribution keeps them apart.
kernel_packages() {
    local meta
    for meta in $meta_packages; do
        apt-cache "${apt_options[@]}" depends --recurse --important "$meta" 2>/dev/null |
            grep -E '^linux-(image|modules|modules-extra)-[0-9]' && return
    done
}

packages=$(kernel_packages || true)
image=$(grep -m 1 '^linux-image-' <<<"$packages" || true)
if [ -z "$image" ]; then
    image=$(cd "$store" && ls -dt linux-image-*/complete 2>/dev/null | head -n 1 | xargs -r dirname)
    [ -n "$image" ] || skip "apt knows none of the packages $meta_packages"
fi
version=${image#linux-image-}
root=$store/$image

if [ ! -e "$root/complete" ]; then
    rm -rf "$root"
    mkdir -p "$root"
    # shellcheck disable=SC2086  # a list of words on purpose
    (cd "$root" && apt-get -q "${apt_options[@]}" download $packages >/dev/null 2>&1) ||
        skip "the kernel package $image could not be downloaded"
    for package in "$root"/*.deb; do
        dpkg-deb -x "$package" "$root"
    done
    rm "$root"/*.deb
    [ -e "$root/lib" ] || ln -s usr/lib "$root/lib"   # newer packages
    depmod -b "$root" "$version"
    touch "$root/complete"
fi
echo "$root $version"
