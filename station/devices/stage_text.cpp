#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include <iostream>
#include <set>

#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "report/json_text.h"
#include "station/devices/commands.h"
#include "station/setup/station_lock.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

using Seconds = std::chrono::duration<double>;

std::string print(const Json& json) {
    return text_of(json) + "\n";
}

// The worst first.
std::vector<std::string> state_words(const AxisStatus& status, const StageProfile& profile) {
    std::vector<std::string> words;
    if (status.emergency_stop)
        words.push_back("EMERGENCY STOP");
    if (status.alarm != 0)
        words.push_back(profile.describe_alarm(status.alarm));
    if (status.limit)
        words.push_back("at a limit switch");
    words.push_back(status.enabled ? "enabled" : "off");
    if (profile.has(Signal::homed))
        words.push_back(status.homed ? "homed" : "not homed");
    if (status.homing || status.moving)
        words.push_back(status.homing ? "homing" : "moving");
    else
        words.push_back(status.in_position ? "in position" : "at rest");
    return words;
}

std::string segment_text(const MotionSegment& segment, std::span<const Axis> axes) {
    std::vector<std::string> words;
    for (std::size_t i = 0; i < axes.size(); ++i)
        if (segment.to[i] != segment.from[i])
            words.push_back(fmt::format("{}={:.3f}", axes[i].name,
                                        segment.to[i] / AxisUnits(axes[i].kind).per_large()));
    return words.empty() ? "stays" : fmt::format("{}", fmt::join(words, " "));
}

Json positions_json(std::span<const Axis> axes, const std::vector<double>& positions) {
    Json json = Json::object();
    for (std::size_t i = 0; i < axes.size(); ++i)
        json[axes[i].name] = positions[i] / AxisUnits(axes[i].kind).per_large();
    return json;
}

std::string link_text(const LinkDefaults& link) {
    if (link.transport == LinkDefaults::Transport::tcp)
        return "Modbus TCP";
    return fmt::format("Modbus RTU, {} baud, {}{}{}", link.serial.baud, link.serial.data_bits,
                       link.serial.parity, link.serial.stop_bits);
}

constexpr Signal all_signals[] = {Signal::enabled, Signal::ready,          Signal::homed,
                                  Signal::moving,  Signal::homing,         Signal::in_position,
                                  Signal::alarm,   Signal::emergency_stop, Signal::limit};

std::vector<std::string> missing_signals(const StageProfile& profile) {
    std::vector<std::string> names;
    for (const Signal signal : all_signals)
        if (!profile.has(signal))
            names.push_back(name_of(signal));
    return names;
}

std::string watchdog_text(const StageProfile& profile) {
    if (!profile.watchdog)
        return "none: axes that move go on when this program is killed or its link is cut";
    return fmt::format("the controller stops the axes {} ms after the last it heard",
                       profile.watchdog->timeout.count());
}

// The stage with its rules, and how it is shown. Traces go to stderr.
class Session {
public:
    Session(const StationStage& stage, bool trace, Opening opening = Opening::asks)
        : profile_(named_stage_profile(stage.profile)),
          stage_(open_stage(stage.link, stage.profile, stage.axes, clock_, opening), stage.rules) {
        if (trace)
            stage_.set_trace([](const std::string& line) { print_stderr("{}\n", line); });
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
    print_stderr(
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
        "Of a controller that does not tell whether its axes are homed, --homed confirms\n"
        "it, if they were homed since they were switched on.\n");
    command.required("TARGET", asked->targets, target);
    command.option("--speed", asked->speed_percent, "percent of the axes' speeds (100)", "P")
        .in_range(0.1, 100.0);
    command.flag("--homed", asked->homed, homed_help);
    command.option("--operator", asked->operator_name, operator_help, "NAME");
}

int run_stage_plan(const StageArguments& arguments) {
    const StationFile station = read_station(arguments.station);
    const auto text = arguments.json ? stage_plan_json : stage_plan_text;
    fmt::print("{}", text(station.stage.axes, plan_of(station)));
    return 0;
}

int run_stage_check(const StageArguments& arguments) {
    const StageProfile profile = named_stage_profile(arguments.profile);
    fmt::print("{}", arguments.json ? stage_profile_json(profile) : stage_profile_text(profile));
    return 0;
}

}  // namespace

std::string stage_status_text(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                              const StageProfile& profile) {
    std::string text;
    for (std::size_t i = 0; i < axes.size(); ++i)
        text += wrapped_text(fmt::format("{:<8}{:12.4f} {:<3}  ", axes[i].name,
                                         statuses[i].position / AxisUnits(axes[i].kind).per_large(),
                                         AxisUnits(axes[i].kind).large().name),
                             fmt::format("{}", fmt::join(state_words(statuses[i], profile), ", ")));
    return text;
}

std::string stage_status_json(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                              const StageProfile& profile) {
    Json json = {{"etalon", "stage/1"}, {"profile", profile.name}, {"axes", Json::array()}};
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const AxisStatus& status = statuses[i];
        json["axes"].push_back({{"name", axes[i].name},
                                {"position", status.position / AxisUnits(axes[i].kind).per_large()},
                                {"unit", AxisUnits(axes[i].kind).large().name},
                                {"enabled", status.enabled},
                                {"homed", status.homed},
                                {"moving", status.moving},
                                {"homing", status.homing},
                                {"in_position", status.in_position},
                                {"ready", status.ready},
                                {"limit", status.limit},
                                {"emergency_stop", status.emergency_stop},
                                {"alarm", status.alarm}});
    }
    return print(json);
}

std::string stage_plan_text(std::span<const Axis> axes, const Plan& plan) {
    std::string text = "pose   time  speed  to (mm, deg)\n";
    std::size_t motions = 0;
    for (std::size_t pose = 0; pose < plan.legs.size(); ++pose)
        for (const MotionSegment& segment : plan.legs[pose]) {
            ++motions;
            const bool first = &segment == &plan.legs[pose].front();
            std::string where = segment_text(segment, axes);
            if (!segment.near.empty())
                where += fmt::format(" (near {})", fmt::join(segment.near, ", "));
            text += wrapped_text(
                fmt::format("{:>4} {:5.1f}s {:4.0f} %  ", first ? std::to_string(pose + 1) : "",
                            Seconds(segment.time).count(), 100.0 * segment.speed_share),
                where);
        }
    return text + fmt::format("{} poses in {} motions, about {} without homing\n",
                              plan.poses.size(), motions, duration_text(plan.expected_duration));
}

std::string stage_plan_json(std::span<const Axis> axes, const Plan& plan) {
    const auto motion_json = [&](const MotionSegment& segment) -> Json {
        return {{"from", positions_json(axes, segment.from)},
                {"to", positions_json(axes, segment.to)},
                {"time_s", Seconds(segment.time).count()},
                {"speed_share", segment.speed_share},
                {"near", segment.near}};
    };
    Json poses = Json::array();
    for (std::size_t pose = 0; pose < plan.legs.size(); ++pose)
        poses.push_back({{"target", positions_json(axes, plan.poses[pose].target)},
                         {"hold_out", plan.poses[pose].hold_out},
                         {"motions", json_list(plan.legs[pose], motion_json)}});
    return print({{"etalon", "stage-plan/1"},
                  {"duration_s", Seconds(plan.expected_duration).count()},
                  {"poses", poses}});
}

std::string stage_profile_text(const StageProfile& profile) {
    std::string text = wrapped_text(profile.name + ": ", profile.about);
    text += fmt::format("  {} {} a unit, {}\n", profile.max_axes,
                        profile.max_axes == 1 ? "axis" : "axes", link_text(profile.link));
    const auto list = [&](const char* title, const std::vector<std::string>& items) {
        text += fmt::format("  {}\n", title);
        for (const std::string& item : items)
            text += wrapped_text("    - ", item);
        if (items.empty())
            text += "    nothing\n";
    };
    list("confirmed by the vendor's documents", profile.confirmed);
    list("not confirmed", profile.unconfirmed);
    const std::vector<std::string> missing = missing_signals(profile);
    if (!missing.empty())
        text += wrapped_text("  does not tell: ", fmt::format("{}", fmt::join(missing, ", ")));
    return text + wrapped_text("  watchdog: ", watchdog_text(profile)) + "profile valid\n";
}

std::string stage_profile_json(const StageProfile& profile) {
    return print(
        {{"etalon", "stage-profile-check/1"},
         {"name", profile.name},
         {"about", profile.about},
         {"max_axes", profile.max_axes},
         {"confirmed", profile.confirmed},
         {"unconfirmed", profile.unconfirmed},
         {"missing_signals", missing_signals(profile)},
         {"watchdog_ms", profile.watchdog ? Json(profile.watchdog->timeout.count()) : Json()}});
}

std::vector<double> typed_target(std::span<const Axis> axes, const std::vector<std::string>& words,
                                 std::span<const double> from, bool relative) {
    std::vector<double> target(from.begin(), from.end());
    std::set<std::string> named;
    for (const std::string& word : words) {
        const std::size_t equals = std::min(word.find('='), word.size());
        const std::string name = word.substr(0, equals);
        const auto value =
            equals < word.size() ? parse_number(word.substr(equals + 1)) : std::nullopt;
        const auto axis = std::ranges::find(axes, name, &Axis::name);
        if (!value || axis == axes.end())
            throw ConfigError(
                {"stage target"},
                fmt::format("'{}' is not AXIS=NUMBER of an axis that there is", word));
        if (!named.insert(name).second)
            throw ConfigError({"stage target"}, fmt::format("axis {} is named twice", name));
        double& position = target[static_cast<std::size_t>(axis - axes.begin())];
        position = (relative ? position : 0.0) + *value * AxisUnits(axis->kind).per_large();
    }
    return target;
}

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
        const std::string trace(trimmed(session.stage().trace()));
        const std::string last = trace.substr(trace.rfind('\n') + 1);
        return fail(ExitCode::run_error,
                    "the stage did NOT confirm that its axes stand still; last request: " +
                        last.substr(std::min(last.find("unit "), last.size())));
    }
    session.show(arguments.json);
    return 0;
}

int run_stage_trace(const StageArguments& arguments) {
    Session session(read_station_stage(arguments.station), false);
    session.stage().set_trace([](const std::string& line) { fmt::print("{}\n", line); });
    for (int poll = 0; poll < arguments.polls; ++poll)
        session.stage().status();
    return 0;
}

void declare_stage(Command& program) {
    Command stage = program.add_group("stage", "look at, home, move and stop the stage");
    declare_on_stage(stage, run_stage_status, "status", "show where the axes are and how they are");
    auto [home, homing] =
        declare_on_stage(stage, run_stage_home, "home", "enable the axes and find their zeros",
                         "Asks first: homing goes the controller's own way, whatever is in it.\n");
    home.flag("--yes", homing->yes, "do not ask (needed without a terminal)");
    home.option("--operator", homing->operator_name, operator_help, "NAME");
    declare_motion(stage, run_stage_move, "move", "move axes to positions",
                   "x=12.5 rz=-3: mm or degrees");
    declare_motion(stage, run_stage_jog, "jog", "move axes by some way",
                   "x=0.5 rz=-1: by so many mm or degrees");
    declare_on_stage(stage, run_stage_stop, "stop",
                     "stop every axis; exit code 0 only if that is confirmed");
    auto [trace, traced] =
        stage.add(run_stage_trace, "trace", "read the status and print every Modbus exchange",
                  "Writes nothing.\n");
    trace.required("STATION", traced->station, station_help);
    trace.option("--polls", traced->polls, "how often (1)", "N").within(1, 1000000);
    declare_on_stage(stage, run_stage_plan, "plan", "print a run's way without moving anything",
                     "Needs the whole station.yaml; touches no device.\n");
    auto [check, checked] = stage.add(run_stage_check, "check",
                                      "check a controller's profile and say how well it is known",
                                      "Exit code 0: valid, 3: not, with file, line and key.\n");
    check.required("PROFILE", checked->profile, "a file.yaml, or the name of a built-in one");
}

}  // namespace etalon
