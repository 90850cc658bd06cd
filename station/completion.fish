# fish completion for etalon
function __etalon_words
    set -l words (commandline -opc)
    set -l current (commandline -ct)
    for line in ($words[1] completion words -- $words[2..-1] "$current" 2>/dev/null)
        switch $line
            case ':files' ':folders'
                __fish_complete_path $current
            case ':files *'
                __fish_complete_suffix .yaml
            case '*'
                echo $line
        end
    end
end
complete -c etalon -f -a '(__etalon_words)'
