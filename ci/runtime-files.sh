#!/bin/sh
# Copies to FOLDER what the installed programs need at run time: their packages' files, the libraries
# that the linker loads, and the licence of each package that these come from. Debian's OpenCV depends
# on desktop toolkits and drivers of graphics cards, 300 MB that no program of ours loads. What
# /base-packages names, a package a line, is in the image already.
#     ci/runtime-files.sh FOLDER
set -eu
folder=$1

# The package of a file; packages may name it as it was before /lib became a link to /usr/lib.
package_of() {
    { dpkg -S "$1" || dpkg -S "${1#/usr}"; } 2>/dev/null | sed -n '1s/:.*//p'
}

# usrmerged PATH: /lib/... is /usr/lib/...
usrmerged() {
    echo "/usr${1#/usr}"
}

mkdir -p "$folder"
for library in $(ldd /usr/bin/etalon /usr/bin/etalon-twin /usr/lib/*/etalon/*.so | sed -n 's/.*=> \(\/[^ ]*\).*/\1/p' | sort -u); do
    package=$(package_of "$(usrmerged "$(readlink -f "$library")")")
    case $package in etalon | libetalon0) continue ;; esac
    grep -qx "$package" /base-packages && continue
    usrmerged "$library"
    [ ! -e "/usr/share/doc/$package/copyright" ] || echo "/usr/share/doc/$package/copyright"
done | sort -u >/tmp/libraries
# As files, whatever links lead to them.
tar -c -h --hard-dereference -T /tmp/libraries | tar -x -C "$folder"

dpkg -L etalon libetalon0 | while read -r file; do
    [ -d "$file" ] || [ ! -e "$file" ] || usrmerged "$file"
done >/tmp/files
tar -c -T /tmp/files | tar -x -C "$folder"
