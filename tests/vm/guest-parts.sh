#!/bin/bash
# guest-parts.sh LIST: runs in the guest what stands in LIST (tests/vm/CMakeLists.txt writes it), line
# by line:
#
#   part NAME MODULE... -- COMMAND [ARGUMENT]...
#
# and leaves each part's output and exit status in /run/results: guest-part.sh reads them. 77 where
# the kernel lacks a module.
part() {
    local name=$1 status=0 begin=$SECONDS
    shift
    {
        while [ "$1" != -- ]; do
            # shellcheck disable=SC2086  # a module and its parameters
            modprobe $1 || { echo "skipped: the kernel has no $1"; status=77; }
            shift
        done
        shift
        [ "$status" -ne 0 ] || "$@" || status=$?
    } >"/run/results/$name.log" 2>&1
    echo "$status" >"/run/results/$name.status"
    echo "$name: exit status $status after $((SECONDS - begin)) s"
}

# shellcheck source=/dev/null
. "$1"
