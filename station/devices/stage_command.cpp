// `etalon stage`: the stage of a station.yaml by hand, with the same rules as a run.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <cstdio>
#include <iostream>

#include "core/errors.h"
#include "core/exit_codes.h"
#include "stage/motion/guarded_stage.h"
#include "station/devices/stage_text.h"
#include "station/shell/commands.h"
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
    GuardedStage stage_;
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
    Session session(station, arguments.trace);
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

}  // namespace etalon
