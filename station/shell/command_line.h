// What the files that describe the command line of `etalon` share. They alone include CLI11, which
// takes seconds to compile.
#pragma once

#include <functional>
#include <memory>
#include <string>

namespace CLI {
class App;
class Validator;
}  // namespace CLI

namespace etalon {

// What the chosen command is to do; returns its exit code.
using Run = std::function<int()>;

CLI::Validator positive_number();
CLI::Validator whole_number();
CLI::Validator within(int low, int high);

// A sub-command that sets `run` to `command` when it is chosen.
CLI::App* add_command(CLI::App& app, Run& run, Run command, bool& json, const std::string& name,
                      const std::string& summary, const std::string& details);

// The same; its arguments live as long as its closure.
template <class Arguments>
CLI::App* add_command(CLI::App& app, Run& run, const std::shared_ptr<Arguments>& arguments,
                      int (*command)(const Arguments&), const std::string& name,
                      const std::string& summary, const std::string& details) {
    return add_command(
        app, run, [arguments, command] { return command(*arguments); }, arguments->json, name,
        summary, details);
}

// `etalon qualify`, `plan`, `oc`, `report` and `history`.
void add_qualify_commands(CLI::App& app, Run& run);

// `etalon stage ...`.
void add_stage_commands(CLI::App& app, Run& run);

// `etalon register`, `etalon expect` and `etalon study`.
void add_metrology_commands(CLI::App& app, Run& run);

}  // namespace etalon
