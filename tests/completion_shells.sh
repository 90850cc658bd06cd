#!/usr/bin/env bash
# The completion scripts in the shells that they are for, each as far as it is installed. Exit 77
# (skipped) where none is.
#     tests/completion_shells.sh BUILD_FOLDER
set -euo pipefail
export PATH=$1:$PATH
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$scratch"
touch station.yaml picture.png
mkdir folder
for shell in bash zsh fish; do etalon completion $shell >script.$shell; done
tried=0

# expect SHELL FOUND WORDS...: every word is among the found lines.
expect() {
    local shell=$1 found=$2 word
    shift 2
    for word in "$@"; do
        grep -qxF -- "$word" <<<"$found" || {
            printf '%s does not offer %s but:\n%s\n' "$shell" "$word" "$found" >&2
            exit 1
        }
    done
}

# in_bash WORDS...: what the tab key offers for the last word.
in_bash() {
    bash -c '
        . /usr/share/bash-completion/bash_completion
        . ./script.bash
        COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMP_LINE=$* COMP_POINT=${#COMP_LINE}
        compopt() { :; }
        _etalon
        printf "%s\n" "${COMPREPLY[@]}"' bash "$@"
}
if [ -e /usr/share/bash-completion/bash_completion ]; then
    tried=$((tried + 1))
    expect bash "$(in_bash etalon qua)" qualify
    expect bash "$(in_bash etalon qualify '')" station.yaml folder
    expect bash "$(in_bash etalon qualify --out '')" folder
    expect bash "$(in_bash etalon detect --detector ch)" chessboard charuco
fi

# Completion of zsh runs inside its line editor only: a shell in a terminal of its own, whose
# functions that add candidates print them.
if command -v zsh >/dev/null; then
    tried=$((tried + 1))
    found=$(zsh -f -c '
        compdef() { :; }
        compadd() { while [[ $1 != -- ]]; do shift; done; shift; print -l -- "$@"; }
        _describe() { local line; for line in "${(@P)2}"; do print -- "${${line//\\:/;}%%:*}"; done; }
        _files() { print -l -- files "$@"; }
        . ./script.zsh
        for typed in "etalon qua" "etalon qualify " "etalon marker stag:HD1"; do
            words=("${(@s: :)typed}") CURRENT=${#words}
            _etalon
        done')
    expect zsh "$found" qualify files '*.(yaml|yml)' stag:HD17:
fi

if command -v fish >/dev/null; then
    tried=$((tried + 1))
    in_fish() { HOME=$scratch fish --no-config -c "source script.fish; complete -C '$1'" | cut -f1; }
    expect fish "$(in_fish 'etalon qua')" qualify
    expect fish "$(in_fish 'etalon qualify st')" station.yaml
    expect fish "$(in_fish 'etalon calibrate --model kan')" kannala_brandt
fi
[ $tried -gt 0 ] || { echo "neither bash-completion nor zsh nor fish is installed"; exit 77; }
echo "$tried shells"
