#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "calib/files/foreign_camera.h"
#include "calib/intrinsics/calibration_model.h"
#include "compare/make_detector.h"
#include "report/json_text.h"
#include "sim/marker/stag_pattern.h"
#include "sim/marker/tag_pattern.h"
#include "sim/marker/topotag_pattern.h"
#include "stage/profile/profile.h"
#include "station/commands.h"
#include "station/completion.bash.h"
#include "station/completion.fish.h"
#include "station/completion.zsh.h"
#include "station/completion_help.txt.h"
#include "study/study_file.h"

namespace etalon {
namespace {

using Words = std::vector<std::string>;

const Words* families_of(const std::string& kind) {
    if (kind == "apriltag" || kind == "aprilgrid")
        return &apriltag_families();
    if (kind == "aruco" || kind.starts_with("charuco"))
        return &aruco_dictionaries();
    if (kind == "stag")
        return &stag_families();
    return kind == "topotag" ? &topotag_families() : nullptr;
}

Words marker_words() {
    Words words;
    for (const std::string& kind : marker_kinds())
        if (const Words* families = families_of(kind))
            for (const std::string& family : *families)
                words.push_back(kind + ":" + family + ":");
        else
            words.push_back(kind + ":");
    return words;
}

Words photometric_too() {
    Words words = detector_names();
    words.emplace_back("photometric");
    return words;
}

Words model_words() {
    Words words = {"auto"};
    for (const auto* models :
         {&calibration_models(), &wide_calibration_models(), &telecentric_calibration_models()})
        for (const CalibrationModel& model : *models)
            words.push_back(model.name);
    return words;
}

Words tool_words() {
    Words words = {"etalon"};
    for (const CalibrationTool tool : calibration_tools())
        words.emplace_back(name_of(tool));
    return words;
}

Words profile_words() {
    Words words = builtin_stage_profile_names();
    words.emplace_back(":files yaml|yml");
    return words;
}

Words yaml_files() {
    return {":files yaml|yml"};
}

struct NamedValue {
    const char* name;  // of the option or argument
    std::function<Words()> words;
};

const NamedValue named_values[] = {
    {"--marker", marker_words},      {"--target", marker_words},   {"MARKER", marker_words},
    {"--detector", photometric_too}, {"--model", model_words},     {"--to", tool_words},
    {"PROFILE", profile_words},      {"--profile", profile_words}, {"--ablate", study_switch_names},
    {"STATION", yaml_files},         {"--station", yaml_files},    {"STUDY", yaml_files}};

const DescribedOption* find_option(const DescribedCommand& command, const std::string& word) {
    const auto found = std::ranges::find_if(command.options, [&](const DescribedOption& option) {
        return !option.is_argument && std::ranges::count(option.names, word) != 0;
    });
    return found == command.options.end() ? nullptr : &*found;
}

struct Position {
    const DescribedCommand* command;
    const DescribedOption* option = nullptr;  // whose value is next
    std::size_t arguments = 0;                // that have been given
    bool is_over = false;                     // after "--", what follows is not ours
};

void take_word(const std::string& word, Position& at) {
    if (std::exchange(at.option, nullptr))
        return;
    if (word == "--")
        at.is_over = true;
    if (word.starts_with("-")) {
        const DescribedOption* option = find_option(*at.command, word);
        at.option = option && !option->value.empty() ? option : nullptr;
        return;
    }
    const auto sub = std::ranges::find(at.command->commands, word, &DescribedCommand::name);
    if (at.arguments == 0 && sub != at.command->commands.end())
        at.command = &*sub;
    else
        ++at.arguments;
}

// The argument at this place; the last one stands for all that follow.
const DescribedOption* next_argument(const Position& at) {
    const DescribedOption* argument = nullptr;
    std::size_t place = 0;
    for (const DescribedOption& option : at.command->options)
        if (option.is_argument && place++ <= at.arguments)
            argument = &option;
    return argument;
}

std::string with_help(const std::string& word, const std::string& help) {
    return word + "\t" + help.substr(0, help.find('\n'));
}

Words all_candidates(const Position& at, const std::string& current) {
    if (at.is_over)
        return {};
    if (at.option)
        return words_of_value(*at.option);
    Words words;
    if (current.starts_with("-")) {
        for (const DescribedOption& option : at.command->options)
            if (!option.is_argument)
                words.push_back(with_help(option.names.back(), option.help));
        return words;
    }
    if (at.arguments == 0)
        for (const DescribedCommand& sub : at.command->commands)
            words.push_back(with_help(sub.name, sub.summary));
    if (const DescribedOption* argument = next_argument(at))
        std::ranges::copy(words_of_value(*argument), std::back_inserter(words));
    return words;
}

void add_command_lines(const DescribedCommand& command, const std::string& before, Words& lines) {
    for (const DescribedCommand& sub : command.commands) {
        const bool is_group = !find_option(sub, "--json");
        if (!is_group)
            lines.push_back(with_help(before + sub.name, sub.summary));
        add_command_lines(sub, before + sub.name + " ", lines);
    }
}

}  // namespace

std::vector<std::string> words_of_value(const DescribedOption& option) {
    if (!option.choices.empty())
        return option.choices;
    for (const NamedValue& named : named_values)
        if (std::ranges::count(option.names, named.name) != 0)
            return named.words();
    return {option.value == "DIR" || option.names.front() == "DIR" ? ":folders" : ":files"};
}

std::vector<std::string> completed_words(const DescribedCommand& program,
                                         const std::vector<std::string>& words) {
    Position at{&program};
    const std::string current = words.empty() ? "" : words.back();
    for (std::size_t i = 0; i + 1 < words.size(); ++i)
        take_word(words[i], at);
    Words candidates = all_candidates(at, current);
    std::erase_if(candidates, [&](const std::string& word) {
        return !word.starts_with(":") && !word.starts_with(current);
    });
    return candidates;
}

std::vector<std::string> command_lines(const DescribedCommand& program) {
    Words lines;
    add_command_lines(program, "", lines);
    return lines;
}

// `etalon completion`: what bash, zsh and fish ask for when a user presses the tab key. The scripts
// hold no words themselves: they ask this program, so that they are always its own.

namespace {

struct CompletionArguments {
    std::string what;
    std::vector<std::string> words;
    bool json = false;
};

std::vector<std::string> lines_of(const CompletionArguments& arguments) {
    if (arguments.what == "bash")
        return {completion_bash};
    if (arguments.what == "zsh")
        return {completion_zsh};
    if (arguments.what == "fish")
        return {completion_fish};
    const DescribedCommand program = describe_program(declare_commands);
    return arguments.what == "commands" ? command_lines(program)
                                        : completed_words(program, arguments.words);
}

int run_completion(const CompletionArguments& arguments) {
    const std::vector<std::string> lines = lines_of(arguments);
    if (arguments.json)
        fmt::print("{}\n", text_of(Json(lines)));
    else
        fmt::print("{}\n", fmt::join(lines, "\n"));
    return 0;
}

}  // namespace

void declare_completion(Command& program) {
    auto [command, asked] =
        program.add(run_completion, "completion", "what shells need to complete a command line",
                    completion_help_txt);
    command.option("WHAT", asked->what, "bash, zsh, fish, words or commands")
        .one_of({"bash", "zsh", "fish", "words", "commands"})
        .require();
    command.option("WORDS", asked->words, "after `--`: what is typed behind the program's name");
}

}  // namespace etalon
