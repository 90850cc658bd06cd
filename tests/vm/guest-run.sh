#!/usr/bin/env bash
# guest-run.sh FOLDER LIST...: boots a guest for each list, all at once, and runs in it the parts in
# the list (guest-parts.sh). Their results are in FOLDER afterwards, and in FOLDER/guests what became
# of the guests. Exit 77 with the reason where no guest can run.
set -o pipefail
here=$(cd "$(dirname "$0")" && pwd)
folder=$1
shift
rm -rf "$folder"
mkdir -p "$folder"

guests=()
for list in "$@"; do
    "$here/run-in-guest.sh" -t 600 -w "$folder" bash "$here/guest-parts.sh" "$list" 2>&1 |
        tee -a "$folder/guests" &
    guests+=($!)
done
skipped=0
for guest in "${guests[@]}"; do
    wait "$guest" || [ $? -ne 77 ] || skipped=77
done
exit "$skipped"   # a guest that fell over has parts without a result, which fail
