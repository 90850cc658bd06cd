# bash completion for etalon; needs the package bash-completion
_etalon() {
    local cur prev words cword word rest
    _init_completion -n := || return
    while IFS=$'\t' read -r word rest; do
        case $word in
            ':files') _filedir ;;
            ':files '*) _filedir "@(${word#:files })" ;;
            ':folders') _filedir -d ;;
            *) COMPREPLY+=("$word") ;;
        esac
    done < <("${words[0]}" completion words -- "${words[@]:1:cword}" 2>/dev/null)
    [[ ${COMPREPLY[0]-} == *: ]] && compopt -o nospace
    __ltrim_colon_completions "$cur"
}
complete -F _etalon etalon
