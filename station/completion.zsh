#compdef etalon
_etalon() {
    local line word
    local -a known open
    local found=1
    for line in "${(@f)$("$words[1]" completion words -- "${(@)words[2,CURRENT]}" 2>/dev/null)}"; do
        word=${line%%$'\t'*}
        case $word in
            '') ;;
            ':files') _files && found=0 ;;
            ':files '*) _files -g "*.(${word#:files })" && found=0 ;;
            ':folders') _files -/ && found=0 ;;
            *:) open+=("$word") ;;
            *) known+=("${word//:/\\:}:${line#*$'\t'}") ;;
        esac
    done
    (( ${#open} )) && compadd -S '' -- "${open[@]}" && found=0
    (( ${#known} )) && _describe etalon known && found=0
    return found
}
if [ "$funcstack[1]" = _etalon ]; then
    _etalon "$@"
else
    compdef _etalon etalon
fi
