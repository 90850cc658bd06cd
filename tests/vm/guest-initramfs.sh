#!/usr/bin/env bash
# guest-initramfs.sh KERNEL_FOLDER VERSION OUT: the first file system of the guest: busybox, and the
# modules without which it does not reach the host's files (9p over virtio).
set -euo pipefail
kernel=$1 version=$2 out=$3
here=$(dirname "$0")

tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
mkdir -p "$tree"/{bin,modules,proc,sys,dev,host,overlay,root}
cp /bin/busybox "$tree/bin/"
cp "$here/guest-init.sh" "$tree/init"

# In the order in which they must be loaded; some distributions compress them.
modprobe -d "$kernel" -S "$version" -D -a virtio_pci 9pnet_virtio 9p overlay |
    awk '$1 == "insmod" && !seen[$2]++ { print $2 }' | while read -r module; do
        name=$(printf '%02d-%s' "$(ls "$tree/modules" | wc -l)" "$(basename "$module")")
        case $module in
            *.xz)  xz -dc "$module" >"$tree/modules/${name%.xz}" ;;
            *.zst) zstd -dcq "$module" >"$tree/modules/${name%.zst}" ;;
            *)     cp "$module" "$tree/modules/$name" ;;
        esac
    done

(cd "$tree" && find . | cpio -o -H newc --quiet | gzip -1) >"$out.$$"
mv "$out.$$" "$out"
