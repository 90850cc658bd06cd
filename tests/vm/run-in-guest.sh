#!/usr/bin/env bash
# run-in-guest.sh [-m MODULE]... [-t SECONDS] [-w FOLDER] [-v] COMMAND [ARGUMENT]...
#
# Runs a command in a virtual machine that has the distribution's stock kernel, so that it meets
# real device drivers on a machine that has none. The guest sees this machine's files, may change
# none of them (what it writes is gone afterwards), and works in the current folder as root.
# stdout, stderr and the exit status are the command's.
#
#   -m MODULE    a kernel module to load first, with parameters if wished: -m "vivid n_devs=1"
#   -t SECONDS   after which the machine is switched off (default 120)
#   -w FOLDER    that the command may write to: /run/results in the guest
#   -v           the kernel's messages as well
#
# The processor is emulated, never lent (KVM is there on few build machines): programs run about
# twenty times slower. Exit 77 with the reason where it cannot run or the kernel lacks a module, 125
# when the guest came to no end of its own.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
store=$here/../../build/guest

skip() {
    echo "skipped: $*" >&2
    exit 77
}

modules=() limit=120 results="" verbose=""
while getopts m:t:w:v option; do
    case $option in
        m) modules+=("$OPTARG") ;;
        t) limit=$OPTARG ;;
        w) results=$OPTARG ;;
        v) verbose=1 ;;
        *) exit 2 ;;
    esac
done
shift $((OPTIND - 1))
[ $# -gt 0 ] || { echo "usage: run-in-guest.sh [-m MODULE]... [-t SECONDS] [-w FOLDER] [-v] COMMAND..." >&2; exit 2; }

PATH=$PATH:/usr/sbin:/sbin:/lib/systemd
[ "$(uname -m)" = x86_64 ] || skip "the guest runs this machine's programs, and knows x86_64 only"
for tool in qemu-system-x86_64:qemu-system-x86 busybox:busybox-static modprobe:kmod cpio:cpio \
        systemd-udevd:udev apt-get:apt dpkg-deb:dpkg; do
    command -v "${tool%%:*}" >/dev/null || skip "${tool%%:*} is missing (package ${tool#*:})"
done

mkdir -p "$store"
store=$(cd "$store" && pwd)
found=$("$here/guest-kernel.sh" "$store")
read -r kernel version <<<"$found"
initramfs=$kernel/initramfs.img
if [ ! -e "$initramfs" ] || [ "$here/guest-init.sh" -nt "$initramfs" ] ||
        [ "$here/guest-initramfs.sh" -nt "$initramfs" ]; then
    "$here/guest-initramfs.sh" "$kernel" "$version" "$initramfs"
fi

job=$(mktemp -d)
trap 'rm -rf "$job"' EXIT
cp "$here/guest-main.sh" "$job/main"
kernel_modules=$kernel/lib/modules folder=$PWD command=("$@")
declare -p kernel_modules modules command folder >"$job/settings"
: >"$job/stdout" >"$job/stderr"

share() {   # TAG FOLDER [OPTION]
    echo "-fsdev local,id=$1,path=$2,security_model=none,multidevs=remap${3-}"
    echo "-device virtio-9p-pci,fsdev=$1,mount_tag=$1"
}
# A sleeping USB hub takes a device that is pulled out and plugged in again for the same one.
usb=usbcore.autosuspend=-1
# shellcheck disable=SC2046  # lists of words on purpose
timeout -k 5 "$limit" qemu-system-x86_64 -nodefaults -no-user-config -display none -no-reboot \
    -machine pc -accel tcg,thread=multi -cpu max,la57=off -smp 1 -m 1024 \
    -kernel "$kernel/boot/vmlinuz-$version" -initrd "$initramfs" \
    -append "console=ttyS0 loglevel=5 panic=-1 tsc=reliable no_timer_check mitigations=off
             random.trust_cpu=on cryptomgr.notests audit=0 selinux=0 apparmor=0 $usb" \
    -serial "file:$job/console" $(share host / ,readonly=on) $(share job "$job") \
    $([ -z "$results" ] || share results "$results") \
    </dev/null >"$job/qemu" 2>&1 || true

[ -z "$verbose" ] || cat "$job/console" >&2
cat "$job/stdout"
cat "$job/stderr" >&2
if [ ! -s "$job/status" ]; then
    echo "the guest came to no end within $limit s; its last words:" >&2
    tail -n 20 "$job/qemu" "$job/console" >&2
    exit 125
fi
[ -z "$verbose" ] || cat "$job/dmesg" >&2
exit "$(cat "$job/status")"
