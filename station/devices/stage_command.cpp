// `etalon stage`: the stage of a station.yaml by hand, with the same rules as a run.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <cstdio>
#include <iostream>

#include "core/program/errors.h"
#include "stage/motion/motion_guard.h"
#include "station/devices/commands.h"
#include "station/devices/stage_text.h"
#include "station/setup/station_lock.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

// The stage with its rules, and what it is told to show. Traces go to stderr.
class Session {
public:
    Session(const StationStage& stage, bool trace, Opening opening = Opening::asks)
        : profile_(named_stage_profile(stage.profile)),
          stage_(open_stage(stage.link, stage.profile, stage.axes, clock_, opening), stage.rules) {
        if (trace)
            stage_.set_trace([](const std::string& line) { fmt::print(stderr, "{}\n", line); });
    }

    Stage& stage() { return stage_; }

    void show(bool json) {
        const auto statuses = stage_.status();
        const auto text = json ? stage_status_json : stage_status_text;
        fmt::print("{}", text(stage_.axes(), statuses, profile_));
    }

private:
    SteadyClock clock_;
    StageProfile profile_;
    LimitedStage stage_;
};

std::string names_of(const std::vector<Axis>& axes) {
    std::vector<std::string> names;
    for (const Axis& axis : axes)
        names.push_back(axis.name);
    return fmt::format("{}", fmt::join(names, ", "));
}

// Before the signals are taken, so that Ctrl-C ends the question.
void confirm_homing(const std::vector<Axis>& axes, bool yes) {
    if (yes)
        return;
    if (isatty(STDIN_FILENO) == 0)
        throw ConfigError({"--yes"},
                          "is needed where nobody can be asked: homing moves every axis");
    fmt::print(stderr,
               "Homing moves {} until each has found its zero, by the controller's own way:\n"
               "soft limits, forbidden boxes and slow zones do not hold. Is the way clear?\n"
               "Type yes to go on: ",
               names_of(axes));
    std::string answer;
    std::getline(std::cin, answer);
    if (answer != "yes")
        throw Interrupted();
}

// Moves once the axes are known to be homed; `relative`: from where they are.
int move_axes(const StageArguments& arguments, bool relative) {
    std::stop_source stop;
    const StopOnSignals signals(stop);
    const StationStage station = read_station_stage(arguments.station);
    const StationLock lock(station, stage_holder("a motion", arguments.operator_name));
    Session session(station, arguments.trace);
    if (arguments.homed)
        session.stage().take_for_homed();
    session.stage().resume();
    const std::vector<double> target =
        typed_target(station.axes, arguments.targets, session.stage().position(), relative);
    session.stage().limit_speed(arguments.speed_percent / 100.0);
    session.stage().move(target, stop.get_token());
    session.show(arguments.json);
    return 0;
}

}  // namespace

int run_stage_status(const StageArguments& arguments) {
    Session(read_station_stage(arguments.station), arguments.trace).show(arguments.json);
    return 0;
}

int run_stage_home(const StageArguments& arguments) {
    const StationStage station = read_station_stage(arguments.station);
    confirm_homing(station.axes, arguments.yes);
    std::stop_source stop;
    const StopOnSignals signals(stop);
    const StationLock lock(station, stage_holder("homing", arguments.operator_name));
    Session session(station, arguments.trace);
    session.stage().enable(stop.get_token());
    session.stage().home(stop.get_token());
    session.show(arguments.json);
    return 0;
}

int run_stage_move(const StageArguments& arguments) {
    return move_axes(arguments, false);
}

int run_stage_jog(const StageArguments& arguments) {
    return move_axes(arguments, true);
}

// Ctrl-C does not end it: it takes 3 s at most, and half of it would leave the stop on.
int run_stage_stop(const StageArguments& arguments) {
    std::stop_source ignored;
    const StopOnSignals signals(ignored);
    Session session(read_station_stage(arguments.station), arguments.trace, Opening::asks_nothing);
    if (!session.stage().stop()) {
        fmt::print(stderr, "etalon: the stage did NOT confirm that its axes stand still\n");
        return ExitCode::run_error;
    }
    session.show(arguments.json);
    return 0;
}

// Reading only.
int run_stage_trace(const StageArguments& arguments) {
    Session session(read_station_stage(arguments.station), false);
    session.stage().set_trace([](const std::string& line) { fmt::print("{}\n", line); });
    for (int poll = 0; poll < arguments.polls; ++poll)
        session.stage().status();
    return 0;
}

int run_stage_plan(const StageArguments& arguments) {
    const StationFile station = read_station(arguments.station);
    const Plan plan = plan_of(station);
    const auto text = arguments.json ? stage_plan_json : stage_plan_text;
    fmt::print("{}", text(station.stage.axes, plan));
    return 0;
}

int run_stage_check(const StageCheckArguments& arguments) {
    const StageProfile profile = named_stage_profile(arguments.profile);
    fmt::print("{}", arguments.json ? stage_profile_json(profile) : stage_profile_text(profile));
    return 0;
}

namespace {

using StageAction = int (*)(const StageArguments&);

constexpr const char* operator_help = "who moves it: others who want to are told";
constexpr const char* station_help = "station.yaml: its stage section is used";

Declared<StageArguments> declare_on_stage(Command& stage, StageAction action, const char* name,
                                          const char* summary, const char* details = "") {
    auto [command, asked] = stage.add(action, name, summary, details);
    command.required("STATION", asked->station, station_help);
    command.flag("--trace", asked->trace, "print every Modbus exchange on stderr");
    return {command, asked};
}

void declare_motion(Command& stage, StageAction action, const char* name, const char* summary,
                    const char* target) {
    auto [command, asked] = declare_on_stage(
        stage, action, name, summary,
        "Axes that are not named stay. The axes must be homed (`etalon stage home`); soft\n"
        "limits, forbidden boxes and slow zones hold as in a run. Ctrl-C stops the axes.\n"
        "A controller that does not tell whether its axes are homed takes your word for\n"
        "it, if they were homed since they were switched on: --homed.\n");
    command.required("TARGET", asked->targets, target);
    command.option("--speed", asked->speed_percent, "percent of the axes' speeds (100)", "P")
        .in_range(0.1, 100.0);
    command.flag("--homed", asked->homed, homed_help);
    command.option("--operator", asked->operator_name, operator_help, "NAME");
}

void declare_homing(Command& stage) {
    auto [command, asked] =
        declare_on_stage(stage, run_stage_home, "home", "enable the axes and find their zeros",
                         "Asks first: homing goes the controller's own way, whatever is in it.\n");
    command.flag("--yes", asked->yes, "do not ask (needed without a terminal)");
    command.option("--operator", asked->operator_name, operator_help, "NAME");
}

void declare_trace(Command& stage) {
    auto [command, asked] =
        stage.add(run_stage_trace, "trace", "read the status and print every Modbus exchange",
                  "Writes nothing.\n");
    command.required("STATION", asked->station, station_help);
    command.option("--polls", asked->polls, "how often (1)", "N").within(1, 1000000);
}

void declare_check(Command& stage) {
    auto [command, asked] = stage.add(run_stage_check, "check",
                                      "check a controller's profile and say how well it is known",
                                      "Exit code 0: valid, 3: not, with file, line and key.\n");
    command.required("PROFILE", asked->profile, "a file.yaml, or the name of a built-in one");
}

}  // namespace

void declare_stage(Command& program) {
    Command stage = program.add_group("stage", "look at, home, move and stop the stage");
    declare_on_stage(stage, run_stage_status, "status", "show where the axes are and how they are");
    declare_homing(stage);
    declare_motion(stage, run_stage_move, "move", "move axes to positions",
                   "x=12.5 rz=-3: mm or degrees");
    declare_motion(stage, run_stage_jog, "jog", "move axes by some way",
                   "x=0.5 rz=-1: by so many mm or degrees");
    declare_on_stage(stage, run_stage_stop, "stop",
                     "stop every axis; exit code 0 only if that is confirmed");
    declare_trace(stage);
    declare_on_stage(stage, run_stage_plan, "plan", "print a run's way without moving anything",
                     "Needs the whole station.yaml; touches no device.\n");
    declare_check(stage);
}

}  // namespace etalon
