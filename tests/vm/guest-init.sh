#!/bin/busybox sh
# The guest's first process: makes the host's file system the guest's root, read-only below a layer
# in memory that takes all writing, and goes on with guest-main.sh there.
busybox=/bin/busybox
$busybox mount -t proc proc /proc
$busybox mount -t sysfs sysfs /sys
$busybox mount -t devtmpfs devtmpfs /dev
for module in /modules/*; do
    $busybox insmod "$module"
done

transport=trans=virtio,version=9p2000.L,msize=512000
$busybox mount -t 9p -o "ro,cache=loose,$transport" host /host || $busybox poweroff -f
$busybox mount -t tmpfs tmpfs /overlay
$busybox mkdir /overlay/upper /overlay/work
$busybox mount -t overlay -o lowerdir=/host,upperdir=/overlay/upper,workdir=/overlay/work \
    overlay /root
for folder in proc sys dev; do
    $busybox mount --move /$folder /root/$folder
done
$busybox mkdir -p /root/run/guest
$busybox mount -t 9p -o "cache=none,$transport" job /root/run/guest
exec $busybox switch_root /root /bin/bash /run/guest/main
