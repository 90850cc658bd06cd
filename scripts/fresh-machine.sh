#!/usr/bin/env bash
# Proof that a bare machine is enough: makes a minimal Debian 12 root in FOLDER (which must not
# exist), clones the committed state of this project into it, and runs ./demo.sh and ./test.sh there
# with a stock machine's socket buffers, as somebody would who has nothing but git and a shell.
# Prints the time of each step, without a compiler cache. Needs root, debootstrap, 6 GB; takes about
# half an hour. Packages that scripts/package.sh has made are there in build/package.
#
#     scripts/fresh-machine.sh FOLDER [COMMAND...]        default: ./demo.sh, then ./test.sh
#     scripts/fresh-machine.sh FOLDER 'apt-get update' 'apt-get install -y ./build/package/*.deb' \
#         '! command -v c++' 'etalon demo'
set -euo pipefail
project=$(cd "$(dirname "$0")/.." && pwd)
root=${1:?usage: scripts/fresh-machine.sh FOLDER [COMMAND...]}
shift
[ $# -gt 0 ] || set -- ./demo.sh ./test.sh
[ ! -e "$root" ] || { echo "$root exists already" >&2; exit 3; }

# The package mirror is the one that this machine uses.
mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Codename: bookworm' |
    head -n 1)
[ -n "$mirror" ] || { echo "this machine's package sources name no Debian 12" >&2; exit 3; }

timed() {  # timed NAME COMMAND...
    local name=$1 begin=$SECONDS status=0
    shift
    "$@" || status=$?
    printf '== %-28s %5d s   exit %d\n' "$name" $((SECONDS - begin)) $status
    return $status
}

cleanup() {
    mountpoint -q "$root/proc" && umount "$root/proc"
    mountpoint -q "$root/dev" && umount "$root/dev"
    [ -z "${rmem_max:-}" ] || sysctl -qw "net.core.rmem_max=$rmem_max"
}
trap cleanup EXIT

timed "minimal Debian 12" debootstrap --variant=minbase --include=git,ca-certificates \
    bookworm "$root" "$mirror" >"$root.log" || { tail "$root.log" >&2; exit 4; }
tail -n 1 "$root.log"
cp /etc/resolv.conf "$root/etc/"
cp /etc/apt/apt.conf.d/* "$root/etc/apt/apt.conf.d/"   # proxies, where there are any
mount -t proc proc "$root/proc"
mount --bind /dev "$root/dev"

rmem_max=$(sysctl -n net.core.rmem_max)
sysctl -qw net.core.rmem_max=212992

timed "clone" git clone -q "$project" "$root/etalon"
if compgen -G "$project/build/package/*.deb" >/dev/null; then
    mkdir -p "$root/etalon/build/package"
    cp "$project"/build/package/*.deb "$root/etalon/build/package/"
fi
for command in "$@"; do
    timed "$command" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root CCACHE_DISABLE=1 \
        chroot "$root" sh -c "cd /etalon && $command"
done
