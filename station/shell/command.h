// What a command is called, asked and says in its help: declared by each command beside its action,
// listed in station/commands.cpp. A thin layer over CLI11, which takes seconds to compile and is
// parsed in command.cpp alone.
//
// An action gets what is asked (station/*/commands.h). It returns the exit code or throws
// (core/program/errors.h). Stable words and --json go to stdout, everything else to stderr.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <vector>

#include "core/time/progress.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace etalon {

// An argument, option or flag. A value that a rule forbids is a usage error which names it.
class Option {
public:
    explicit Option(CLI::Option& option) : option_(&option) {}

    void require() const;
    Option one_each() const;  // a list: one value after each mention
    Option positive() const;  // a number above 0
    Option whole() const;     // 0, 1, 2 ...
    Option within(int low, int high) const;
    Option in_range(double low, double high) const;
    Option one_of(const std::vector<std::string>& names) const;
    Option needs(const Option& other) const;
    Option excludes(const Option& other) const;

private:
    CLI::Option* option_;
};

template <class Arguments>
struct Declared;

// A command, or the program, with commands below it. Help is printed as it is: 80 columns.
class Command {
public:
    // The chosen command's action is put into `run`, which outlives the command.
    Command(CLI::App& app, std::function<int()>& run) : app_(&app), run_(&run) {}

    // A command with --help and --json that calls `action` when it is chosen and none below it is.
    template <class Arguments>
    Declared<Arguments> add(int (*action)(const Arguments&), const std::string& name,
                            const std::string& summary, const std::string& details) {
        const auto asked = std::make_shared<Arguments>();
        return {
            add([asked, action] { return action(*asked); }, asked->json, name, summary, details),
            asked};
    }
    // A name for several commands, of which one must be chosen.
    Command add_group(const std::string& name, const std::string& summary);

    // `target` keeps its value without the option. Text, path, numbers; optional, vector of some.
    template <class Type>
    Option option(const std::string& name, Type& target, const std::string& help,
                  const std::string& type_name = "");
    template <class Type>
    void required(const std::string& name, Type& target, const std::string& help,
                  const std::string& type_name = "") {
        option(name, target, help, type_name).require();
    }
    Option flag(const std::string& name, bool& target, const std::string& help);

private:
    Command add(std::function<int()> action, bool& json, const std::string& name,
                const std::string& summary, const std::string& details);

    CLI::App* app_;
    std::function<int()>* run_;
};

// A command and what its options are written to, which lives as long as its action.
template <class Arguments>
struct Declared {
    Command command;
    std::shared_ptr<Arguments> asked;
};

struct ProgramText {
    std::string summary, footer;
    std::function<std::string()> version;
};

// Parses the command line. What is returned runs the chosen command and returns its exit code: 0
// after --help and --version, ExitCode::usage_error after a line on stderr.
std::function<int()> parse_command_line(int argc, char** argv, const ProgramText& text,
                                        const std::function<void(Command&)>& declare);

// ---- what is declared, for shells and manuals

struct DescribedOption {
    std::vector<std::string> names;    // "-h", "--help"; of an argument "STATION"
    std::string help, value;           // "DIR"; empty: a flag
    std::vector<std::string> choices;  // the only values, where they are listed
    bool is_argument = false;
};

struct DescribedCommand {
    std::string name, summary;
    std::vector<DescribedOption> options;  // and arguments, in their order
    std::vector<DescribedCommand> commands;
};

// The whole program; nothing of it is run.
DescribedCommand describe_program(const std::function<void(Command&)>& declare);

// Of commands that share nothing else; the others are in commands.h of their module.
void declare_certify(Command& program);
void declare_demo(Command& program);
void declare_expect(Command& program);
void declare_history(Command& program);
void declare_oc(Command& program);
void declare_plan(Command& program);
void declare_qualify(Command& program);
void declare_register(Command& program);
void declare_report(Command& program);
void declare_serve(Command& program);

// One line on stderr, whatever the message that was thrown; returns `exit_code`.
int fail(int exit_code, const std::string& message);

// Help on what several commands ask for.
extern const std::string marker_help, pose_help, homed_help;

// "report FOLDER/report.html" on stdout; nothing without a folder.
void print_report(const std::filesystem::path& folder);

// Progress on stderr, drawn again where that is a terminal.
class StderrProgress : public Progress {
public:
    StderrProgress();

    // step() from every thread.
    void count();

private:
    std::mutex mutex_;
};

// The folder of the running program: no path is compiled in, so it can be installed anywhere.
std::filesystem::path program_folder();

// `name` below share/etalon, for instance "examples/demo/station.yaml": of the prefix that the
// program is installed to, or of its build folder. Throws ConfigError where it is in neither.
std::filesystem::path installed_file(const std::string& name);

}  // namespace etalon
