#!/usr/bin/env bash
# guest-part.sh FOLDER NAME: what became of a part of the guests' run whose results are in FOLDER.
# Output and exit status are the part's. Exit 77 with the reason if no guest could run, 125 if it
# ended before the part did.
folder=$1 name=$2
[ ! -e "$folder/$name.log" ] || cat "$folder/$name.log"
[ ! -e "$folder/$name.status" ] || exit "$(cat "$folder/$name.status")"
cat "$folder/guests"
! grep -q '^skipped: ' "$folder/guests" || exit 77
exit 125
