#!/usr/bin/env bash
# THIRD_PARTY.md names every library that the built programs and plugins are linked with.
#     tests/third_party.sh BUILD_FOLDER
set -euo pipefail
table=$(cd "$(dirname "$0")/.." && pwd)/THIRD_PARTY.md
missing=0
for file in "$1"/etalon "$1"/etalon-twin "$1"/*/libetalon_*.so \
    "$1"/lib/etalon/*.so "$1"/lib/*/etalon/*.so; do
    [ -e "$file" ] || continue
    for library in $(readelf -d "$file" | sed -n 's/.*(NEEDED).*\[\(.*\)\.so.*/\1/p'); do
        case $library in libetalon_*) continue ;; esac
        if ! grep -qF "\`$library\`" "$table"; then
            echo "$file is linked with $library, which $table does not name" >&2
            missing=1
        fi
    done
done
exit $missing
