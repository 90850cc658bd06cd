#include <CLI/CLI.hpp>

#include "station/shell/command_line.h"
#include "station/shell/commands.h"

namespace etalon {
namespace {

CLI::App* add_stage_command(CLI::App& stage, Run& run,
                            const std::shared_ptr<StageArguments>& arguments,
                            int (*command)(const StageArguments&), const std::string& name,
                            const std::string& summary, const std::string& details = "") {
    CLI::App* sub = add_command(stage, run, arguments, command, name, summary, details);
    sub->add_option("STATION", arguments->station, "station.yaml: its stage section is used")
        ->required()
        ->type_name("");
    sub->add_flag("--trace", arguments->trace, "print every Modbus exchange on stderr");
    return sub;
}

constexpr const char* stage_move_details =
    "Axes that are not named stay. The axes must be homed (`etalon stage home`); soft\n"
    "limits, forbidden boxes and slow zones hold as in a run. Ctrl-C stops the axes.\n";

void add_stage_motion(CLI::App& stage, Run& run, const char* name,
                      int (*command)(const StageArguments&), const char* summary,
                      const char* target) {
    auto arguments = std::make_shared<StageArguments>();
    CLI::App* sub =
        add_stage_command(stage, run, arguments, command, name, summary, stage_move_details);
    sub->add_option("TARGET", arguments->targets, target)->required()->type_name("");
    sub->add_option("--speed", arguments->speed_percent, "percent of the axes' speeds (100)")
        ->check(CLI::Range(0.1, 100.0))
        ->type_name("P");
}

void add_stage_homing(CLI::App& stage, Run& run) {
    auto arguments = std::make_shared<StageArguments>();
    CLI::App* sub = add_stage_command(
        stage, run, arguments, run_stage_home, "home", "enable the axes and find their zeros",
        "Asks first: homing goes the controller's own way, whatever is in it.\n");
    sub->add_flag("--yes", arguments->yes, "do not ask (needed without a terminal)");
}

void add_stage_trace(CLI::App& stage, Run& run) {
    auto arguments = std::make_shared<StageArguments>();
    CLI::App* sub =
        add_command(stage, run, arguments, run_stage_trace, "trace",
                    "read the status and print every Modbus exchange", "Writes nothing.\n");
    sub->add_option("STATION", arguments->station, "station.yaml: its stage section is used")
        ->required()
        ->type_name("");
    sub->add_option("--polls", arguments->polls, "how often (1)")
        ->check(within(1, 1000000))
        ->type_name("N");
}

void add_stage_check(CLI::App& stage, Run& run) {
    auto arguments = std::make_shared<StageCheckArguments>();
    add_command(stage, run, arguments, run_stage_check, "check",
                "check a controller's profile and say how well it is known",
                "Exit code 0: valid, 3: not, with file, line and key.\n")
        ->add_option("PROFILE", arguments->profile, "a file.yaml, or the name of a built-in one")
        ->required()
        ->type_name("");
}

}  // namespace

void add_stage_commands(CLI::App& app, Run& run) {
    CLI::App* stage = app.add_subcommand("stage", "look at, home, move and stop the stage");
    stage->set_help_flag("-h,--help", "show this help");
    stage->require_subcommand(1);
    add_stage_command(*stage, run, std::make_shared<StageArguments>(), run_stage_status, "status",
                      "show where the axes are and how they are");
    add_stage_homing(*stage, run);
    add_stage_motion(*stage, run, "move", run_stage_move, "move axes to positions",
                     "x=12.5 rz=-3: mm or degrees");
    add_stage_motion(*stage, run, "jog", run_stage_jog, "move axes by some way",
                     "x=0.5 rz=-1: by so many mm or degrees");
    add_stage_command(*stage, run, std::make_shared<StageArguments>(), run_stage_stop, "stop",
                      "stop every axis; exit code 0 only if that is confirmed");
    add_stage_trace(*stage, run);
    add_stage_command(*stage, run, std::make_shared<StageArguments>(), run_stage_plan, "plan",
                      "print a run's way without moving anything",
                      "Needs the whole station.yaml; touches no device.\n");
    add_stage_check(*stage, run);
}

}  // namespace etalon
