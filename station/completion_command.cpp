// `etalon completion`: what bash, zsh and fish ask for when a user presses the tab key. The scripts
// hold no words themselves: they ask this program, so that they are always its own.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "report/json_text.h"
#include "station/commands.h"
#include "station/completion.h"

namespace etalon {
namespace {

struct CompletionArguments {
    std::string what;
    std::vector<std::string> words;
    bool json = false;
};

// Colons and equal signs part words in bash: bash-completion joins them again.
constexpr const char* bash_script =
    R"sh(# bash completion for etalon; needs the package bash-completion
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
)sh";

constexpr const char* zsh_script = R"sh(#compdef etalon
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
)sh";

constexpr const char* fish_script = R"sh(# fish completion for etalon
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
)sh";

std::vector<std::string> lines_of(const CompletionArguments& arguments) {
    if (arguments.what == "bash")
        return {bash_script};
    if (arguments.what == "zsh")
        return {zsh_script};
    if (arguments.what == "fish")
        return {fish_script};
    const DescribedCommand program = describe_program(declare_commands);
    return arguments.what == "commands" ? command_lines(program)
                                        : completed_words(program, arguments.words);
}

int run_completion(const CompletionArguments& arguments) {
    const std::vector<std::string> lines = lines_of(arguments);
    if (arguments.json)
        fmt::print("{}\n", text_of(nlohmann::ordered_json(lines)));
    else
        fmt::print("{}\n", fmt::join(lines, "\n"));
    return 0;
}

}  // namespace

void declare_completion(Command& program) {
    auto [command, asked] =
        program.add(run_completion, "completion", "what shells need to complete a command line",
                    "`etalon completion bash` (zsh, fish) prints the script for that shell. It is\n"
                    "installed with the program; without that, put into your shell's start-up "
                    "file\n"
                    "    bash: source <(etalon completion bash)\n"
                    "    zsh:  source <(etalon completion zsh)      after compinit\n"
                    "    fish: etalon completion fish | source\n"
                    "`etalon completion words -- WORDS` prints what the last of these words, as "
                    "it\n"
                    "is typed so far, may become: commands, options, kinds and families of "
                    "markers,\n"
                    "detectors, models, profiles; `:files` and `:folders` stand for names of "
                    "files.\n"
                    "`etalon completion commands` prints every command.\n");
    command.option("WHAT", asked->what, "bash, zsh, fish, words or commands")
        .one_of({"bash", "zsh", "fish", "words", "commands"})
        .require();
    command.option("WORDS", asked->words, "after `--`: what is typed behind the program's name");
}

}  // namespace etalon
