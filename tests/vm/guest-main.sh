#!/bin/bash
# Runs in the guest as its first process, below the host's root: sets up what programs expect of a
# running system, runs the command of run-in-guest.sh, and leaves its output and exit status in
# /run/guest, which is a folder of the host's.
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
. /run/guest/settings   # kernel_modules, modules, command, folder

mkdir -p /dev/shm /dev/pts /run/udev /lib/modules
mount -t tmpfs -o mode=1777 tmpfs /dev/shm
mount -t devpts devpts /dev/pts
mount --bind "$kernel_modules" /lib/modules
mkdir -p /run/results
mount -t 9p -o cache=none,trans=virtio,version=9p2000.L results /run/results 2>/dev/null
busybox ip link set lo up
for link in fd:fd stdin:fd/0 stdout:fd/1 stderr:fd/2; do
    ln -sf "/proc/self/${link#*:}" "/dev/${link%%:*}"
done
# As on a real machine: programs learn about devices from udev.
/lib/systemd/systemd-udevd --daemon 2>/dev/null

{
    status=0
    for module in "${modules[@]}"; do
        # shellcheck disable=SC2086  # a module and its parameters
        modprobe $module || { echo "skipped: the kernel has no $module" >&2; status=77; }
    done
    if [ "$status" -eq 0 ]; then
        cd "$folder" && "${command[@]}"
        status=$?
    fi
} >/run/guest/stdout 2>/run/guest/stderr </dev/null
dmesg >/run/guest/dmesg
echo "$status" >/run/guest/status
busybox poweroff -f
