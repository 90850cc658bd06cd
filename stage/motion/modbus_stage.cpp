#include "stage/motion/modbus_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>

#include "core/geometry/units.h"
#include "stage/motion/axis_signals.h"

namespace etalon {
namespace {

// How far an axis at rest may be read elsewhere than where it was left: noise and creep.
constexpr double rest_tolerances = 10.0;

// Consecutive axes of the same unit are one controller's.
std::vector<StageUnit> make_units(ModbusLink& link, const StageProfile& profile, int default_unit,
                                  const std::vector<Axis>& axes) {
    std::vector<StageUnit> units;
    std::set<int> seen;
    for (std::size_t first = 0, end = 0; first < axes.size() || units.empty(); first = end) {
        const auto unit_of = [&](std::size_t i) { return axes[i].unit.value_or(default_unit); };
        while (end < axes.size() && unit_of(end) == unit_of(first))
            ++end;
        const int unit = axes.empty() ? default_unit : unit_of(first);
        if (!seen.insert(unit).second)
            throw ConfigError({"stage axes", 0, axes[first].name},
                              fmt::format("the axes of unit {} must stand together", unit));
        units.emplace_back(link, profile, unit,
                           std::vector<Axis>(axes.begin() + static_cast<std::ptrdiff_t>(first),
                                             axes.begin() + static_cast<std::ptrdiff_t>(end)));
    }
    return units;
}

}  // namespace

ModbusStage::ModbusStage(const StageLink& link, StageProfile profile, std::vector<Axis> axes,
                         Clock& clock, std::unique_ptr<ModbusTransport> transport, Opening opening)
    : profile_(std::move(profile)),
      axes_(std::move(axes)),
      clock_(clock),
      link_(link, clock, std::move(transport)),
      units_(make_units(link_, profile_, link.unit, axes_)) {
    if (opening == Opening::asks_nothing)
        return;
    poll();
    for (StageUnit& unit : units_)
        unit.read_inputs();
}

ModbusStage::~ModbusStage() {
    if (ever_enabled_)
        stop();
}

std::string ModbusStage::trace() const {
    return etalon::describe(link_.last_exchanges());
}

void ModbusStage::set_trace(std::function<void(const std::string&)> line) {
    if (!line)
        return link_.set_trace({});
    link_.set_trace(
        [line = std::move(line), origin = clock_.now()](const ModbusExchange& exchange) {
            line(etalon::describe(exchange, origin));
        });
}

std::vector<AxisStatus> ModbusStage::status() {
    return poll();
}

std::vector<double> ModbusStage::position() {
    constexpr const char* request = "read the positions";
    const Statuses axes = poll();
    const std::string cause =
        disturbance(axes_, axes, std::array{pressed, at_limit, alarmed}, profile_);
    if (!cause.empty())
        throw DeviceError(link_.device(), request, cause);
    require_left_alone(request, axes);
    std::vector<double> positions;
    for (const AxisStatus& axis : axes)
        positions.push_back(axis.position);
    return positions;
}

void ModbusStage::require_usable(const char* request) const {
    if (state_ == State::faulted)
        throw DeviceError(link_.device(), request,
                          "the stage is faulted since an earlier error; only stopping is allowed");
}

// Runs `action`; whatever it throws goes on only after the axes were told to stop.
void ModbusStage::guarded(const std::function<void()>& action) {
    try {
        action();
    } catch (const Interrupted&) {
        if (!stop())
            throw DeviceError(link_.device(), "stop", "interrupted; the stop was NOT confirmed");
        throw;
    } catch (const DeviceError& error) {
        state_ = State::faulted;
        const char* outcome = stop() ? "; the axes were stopped" : "; the stop was NOT confirmed";
        throw DeviceError(error.device(), error.request(), error.cause() + outcome);
    } catch (const std::exception&) {
        state_ = State::faulted;
        stop();
        throw;
    }
}

ModbusStage::Run ModbusStage::begin(const char* request, std::vector<Condition> ends,
                                    std::stop_token stop) {
    if (stop.stop_requested())
        throw Interrupted();
    Run run{.request = request,
            .ends = std::move(ends),
            .stop = std::move(stop),
            .target = {},
            .before = {},
            .started = std::vector<bool>(axes_.size()),
            .now = {}};
    poll(run);
    run.before = run.now;
    return run;
}

void ModbusStage::enable(std::stop_token stop) {
    require_usable("enable");
    guarded([&] {
        const Statuses axes = poll();
        ever_enabled_ = true;
        if (is_stop_left_on() && !this->stop())
            throw DeviceError(link_.device(), "enable",
                              "an earlier program's stop is still on and cannot be ended");
        if (std::ranges::any_of(axes, [](const AxisStatus& axis) { return axis.alarm != 0; })) {
            Run reset = begin("reset the alarms", {pressed}, stop);
            carry_out(profile_.sequences.reset, reset);
        }
        Run run = begin("enable", {pressed, alarmed}, stop);
        carry_out(profile_.sequences.enable, run);
        state_ = State::enabled;
    });
}

// By a program that ended before its stop was confirmed. While it is on, a homing or a start may be
// ignored without a word, and what was homed then still says so.
bool ModbusStage::is_stop_left_on() const {
    return profile_.inputs.contains(Input::stop) &&
           std::ranges::any_of(units_,
                               [](const StageUnit& unit) { return unit.is_on(Input::stop); });
}

// Limit switches may be what the axes look for.
void ModbusStage::home(std::stop_token stop) {
    require_usable("home");
    if (state_ == State::connected)
        throw DeviceError(link_.device(), "home", "the axes are not enabled");
    guarded([&] {
        state_ = State::enabled;
        left_at_.clear();
        Run run = begin("home", {pressed, alarmed, disabled}, std::move(stop));
        keep_watchdog(true);
        carry_out(profile_.sequences.home, run);
        require_seen_to_home(run);
        state_ = State::homed;
    });
}

// Rest alone is no homing: a controller that does not tell may have ignored it.
void ModbusStage::require_seen_to_home(const Run& run) const {
    if (profile_.has(Signal::homed) || taken_for_homed_)
        return;
    const auto still = std::ranges::find(run.started, false);
    if (still != run.started.end())
        throw DeviceError(
            link_.device(), run.request,
            fmt::format("axis {} did not move, and its controller does not tell whether it is "
                        "homed: it may stand at its zero, or not have obeyed. Look at it, then "
                        "say that it is homed: --homed with qualify, stage move or stage jog",
                        axes_[static_cast<std::size_t>(still - run.started.begin())].name));
}

void ModbusStage::require_homed(const Statuses& axes) const {
    if (!profile_.has(Signal::homed) && !taken_for_homed_)
        throw DeviceError(link_.device(), "resume",
                          "the controller does not tell whether its axes are homed: say that they "
                          "are (--homed), if they were homed since they were switched on");
    const auto refuse = [&](std::size_t i, const std::string& what) {
        throw DeviceError(link_.device(), "resume", fmt::format("axis {} {}", axes_[i].name, what));
    };
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (axes[i].alarm != 0)
            refuse(i, "has " + profile_.describe_alarm(axes[i].alarm));
        if (axes[i].emergency_stop)
            refuse(i, "is in emergency stop");
        if (axes[i].moving || axes[i].homing)
            refuse(i, "moves");
        if (!axes[i].enabled)
            refuse(i, "is not enabled: home the axes first");
        if (!axes[i].homed)
            refuse(i, "is not homed: home the axes first");
    }
}

void ModbusStage::resume() {
    require_usable("resume");
    require_homed(poll());
    if (is_stop_left_on())
        throw DeviceError(link_.device(), "resume",
                          "an earlier program's stop is still on: stop the axes again to end it");
    ever_enabled_ = true;
    state_ = State::homed;
}

void ModbusStage::move(std::span<const double> target, std::stop_token stop) {
    require_usable("move");
    if (state_ != State::homed)
        throw DeviceError(link_.device(), "move", "the axes are not homed");
    require_within_limits(axes_, target, {link_.device(), 0, "move"});
    guarded([&] {
        Run run = begin("move", {pressed, at_limit, alarmed, disabled}, std::move(stop));
        require_own_commands(run);
        require_left_alone(run.request, run.now);
        left_at_.clear();
        run.target = target;
        keep_watchdog(true);
        carry_out(profile_.sequences.move, run);
        for (const AxisStatus& axis : run.now)
            left_at_.push_back(axis.position);
    });
}

void ModbusStage::limit_speed(double share) {
    if (!(share > 0.0 && share <= 1.0))
        throw ConfigError({"stage speed"}, fmt::format("a share of {} is not in (0, 1]", share));
    for (const StageUnit& unit : units_)
        unit.require_speed(share);
    speed_share_ = share;
}

// An encoder that jumped, or a stage that was pushed, has lost its zero.
void ModbusStage::require_left_alone(const char* request, const Statuses& axes) const {
    for (std::size_t i = 0; i < left_at_.size(); ++i) {
        if (std::abs(axes[i].position - left_at_[i]) <=
            rest_tolerances * profile_.tolerance(axes_[i]))
            continue;
        Statuses left = axes;
        for (std::size_t k = 0; k < left.size(); ++k)
            left[k].position = left_at_[k];
        throw DeviceError(link_.device(), request,
                          fmt::format("the axes are not where they were left: {}, not {}",
                                      describe(axes), describe(left)));
    }
}

// A stop that was not ours: the next start would undo it.
void ModbusStage::require_own_commands(const Run& run) {
    for (StageUnit& unit : units_)
        if (const std::string change = unit.changed_by_others(); !change.empty())
            throw DeviceError(unit.device(), run.request,
                              "another program or the operator stopped the stage: " + change);
}

std::string ModbusStage::describe(const Statuses& axes) const {
    std::string text;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const bool linear = axes_[i].kind == Axis::Kind::linear;
        const double shown = linear ? axes[i].position : axes[i].position * deg_per_rad;
        text += fmt::format("{}{} at {:.4f} {}{}", i == 0 ? "" : ", ", axes_[i].name, shown,
                            linear ? "mm" : "deg", axes[i].moving ? " and moving" : "");
    }
    return text;
}

bool ModbusStage::stop() noexcept {
    try {
        left_at_.clear();
        const bool stopped = stop_by(clock_.now() + stop_time());
        link_.hurry({});
        if (!stopped)
            state_ = State::faulted;
        return stopped;
    } catch (const std::exception&) {
        state_ = State::faulted;
        return false;
    }
}

std::unique_ptr<Stage> open_stage(const StageLink& link, const std::string& profile,
                                  std::vector<Axis> axes, Clock& clock, Opening opening) {
    return std::make_unique<ModbusStage>(link, named_stage_profile(profile), std::move(axes), clock,
                                         nullptr, opening);
}

}  // namespace etalon
