#include "mocks/stage/simulated_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/statistics/random.h"

namespace etalon {
namespace {

using When = FaultTrigger::When;
using Fault = StageFault::Kind;

constexpr std::uint32_t noise_stream = 1U << 16;  // beside the axes' streams of drawn errors

bool is_usable(const StageFault& fault, std::size_t axes) {
    const bool alarm_fits =
        fault.kind != StageFault::Kind::alarm || (fault.code >= 1 && fault.code <= 65535);
    return fault.axis < axes && fault.at.value >= 0 && std::isfinite(fault.size) && alarm_fits;
}

void require_options(const std::vector<Axis>& axes, const SimulatedStageOptions& options) {
    const SourcePlace place{"simulated stage"};
    if (axes.empty())
        throw ConfigError(place, "needs at least one axis");
    if (!options.errors.empty())
        require_usable(options.errors, axes);
    if (!options.servos.empty() && options.servos.size() != axes.size())
        throw ConfigError(place,
                          fmt::format("{} servos for {} axes", options.servos.size(), axes.size()));
    for (const auto& servo : options.servos)
        if (servo && !(servo->window > 0.0 && std::isfinite(servo->window)))
            throw ConfigError(place, "a servo's window must be finite and more than 0");
    if (!options.power_on_position.empty())
        require_within_limits(axes, options.power_on_position, place);
    if (options.ramp.count() <= 0 || options.homing.count() < 0 || options.jerk.count() < 0)
        throw ConfigError(place, "the ramp must be longer than 0 ms, homing and jerk not negative");
    const StageTemperature& temperature = options.temperature;
    if (!(std::isfinite(temperature.change) && std::isfinite(temperature.time_constant) &&
          temperature.time_constant > 0.0))
        throw ConfigError(place, "the temperature's time constant must be more than 0 s");
    for (const StageFault& fault : options.faults)
        if (!is_usable(fault, axes.size()))
            throw ConfigError(place, "a fault of an axis, at a time, or with a size that is none");
}

// With an entry for every axis.
SimulatedStageOptions complete(SimulatedStageOptions options, const std::vector<Axis>& axes) {
    require_options(axes, options);
    options.errors.resize(axes.size());
    options.power_on_position.resize(axes.size(), 0.0);
    options.servos.resize(axes.size());
    return options;
}

std::vector<StageController> controllers_of(const std::vector<Axis>& axes) {
    std::vector<StageController> controllers;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (i == 0 || axes[i].unit != axes[i - 1].unit)
            controllers.push_back({axes[i].unit, i, 0});
        ++controllers.back().count;
    }
    return controllers;
}

AxisDynamics dynamics_of(const SimulatedStageOptions& options, const std::vector<Axis>& axes,
                         std::size_t axis) {
    const auto in_seconds = [](Duration time) {
        return std::chrono::duration<double>(time).count();
    };
    AxisDynamics dynamics{.acceleration = axes[axis].speed / in_seconds(options.ramp),
                          .servo = options.servos[axis]};
    if (options.jerk.count() > 0)
        dynamics.jerk = dynamics.acceleration / in_seconds(options.jerk);
    return dynamics;
}

}  // namespace

SimulatedStage::SimulatedStage(std::vector<Axis> axes, SimulatedStageOptions options, Clock& clock)
    : axes_(std::move(axes)),
      options_(complete(std::move(options), axes_)),
      clock_(clock),
      power_on_(clock.now()),
      controllers_(controllers_of(axes_)),
      alarms_(controllers_.size(), StageAlarm::none),
      pending_(options_.faults) {
    for (std::size_t c = 0; c < controllers_.size(); ++c) {
        for (std::size_t i = states_.size(); i < controllers_[c].first + controllers_[c].count; ++i)
            states_.push_back({SimulatedAxis(dynamics_of(options_, axes_, i), options_.errors[i],
                                             options_.power_on_position[i]),
                               c});
    }
    std::ranges::stable_sort(pending_, {}, [](const StageFault& fault) { return fault.at.value; });
}

// ---- time

double SimulatedStage::catch_up() {
    const double t = std::chrono::duration<double>(clock_.now() - power_on_).count();
    while (!pending_.empty()) {
        const auto due = std::ranges::find_if(pending_, [t](const StageFault& fault) {
            return fault.at.when == When::time_ms && fault.at.value * 1e-3 <= t;
        });
        if (due == pending_.end())
            break;
        const StageFault fault = *due;
        pending_.erase(due);
        happen(fault, fault.at.value * 1e-3);
    }
    return t;
}

// ---- what is known of an axis

std::span<SimulatedStage::AxisState> SimulatedStage::axes_of(std::size_t controller) {
    const StageController& part = controllers_.at(controller);
    return std::span(states_).subspan(part.first, part.count);
}

std::size_t SimulatedStage::index_of(const AxisState& axis) const {
    return static_cast<std::size_t>(&axis - states_.data());
}

bool SimulatedStage::is_homed(const AxisState& axis, double t) const {
    return axis.homed && t >= axis.homing_until;
}

bool SimulatedStage::moves(const AxisState& axis, double t) const {
    return axis.physics.runs(t) || t < axis.homing_until;
}

bool SimulatedStage::any_moves(std::span<const AxisState> axes, double t) const {
    return std::ranges::any_of(axes, [&](const AxisState& axis) { return moves(axis, t); });
}

// Noise is a function of the time, so that it does not matter who else reads.
double SimulatedStage::reading(const AxisState& axis, double t) const {
    const std::size_t index = index_of(axis);
    RandomStream random(options_.seed, noise_stream + static_cast<std::uint32_t>(index),
                        static_cast<std::uint64_t>(std::llround(t * 1e9)));
    const double sigma = options_.errors[index].encoder_noise;
    return axis.physics.encoder(t) + (sigma > 0.0 ? sigma * random.normal() : 0.0);
}

AxisStatus SimulatedStage::status_of(const AxisState& axis, double t) const {
    const int alarm = alarms_[axis.controller];
    AxisStatus status;
    status.enabled = axis.enabled;
    status.homed = is_homed(axis, t);
    status.homing = axis.homed && t < axis.homing_until;
    status.moving = moves(axis, t) && !axis.claims_arrival;
    status.in_position =
        axis.claims_arrival || (axis.enabled && !status.moving && axis.physics.is_at_target(t));
    status.alarm = alarm;
    status.position = reading(axis, t);
    status.ready = axis.enabled && !status.moving && alarm == StageAlarm::none;
    status.emergency_stop = emergency_stop_;
    status.limit = axis.at_limit;
    return status;
}

double SimulatedStage::drawn_error(std::size_t axis) const {
    RandomStream random(options_.seed, static_cast<std::uint32_t>(axis), motions_);
    return options_.errors[axis].repeatability * random.normal();
}

// ---- commands

void SimulatedStage::brake(std::size_t controller, double t) {
    for (AxisState& axis : axes_of(controller)) {
        axis.homed = is_homed(axis, t);
        axis.homing_until = 0.0;
        axis.claims_arrival = false;
        axis.physics.brake(t);
    }
}

// An alarm that is there already is the cause and stays.
void SimulatedStage::fail(int code, std::size_t controller, double t) {
    if (alarms_.at(controller) == StageAlarm::none)
        alarms_[controller] = code;
    brake(controller, t);
}

void SimulatedStage::enable(bool on, std::size_t controller) {
    const std::scoped_lock lock(mutex_);
    const double t = catch_up();
    for (AxisState& axis : axes_of(controller)) {
        if (axis.enabled && !on) {
            brake(controller, t);
            axis.homed = false;
        }
        axis.enabled = on && !emergency_stop_;
    }
}

void SimulatedStage::home(std::size_t controller) {
    const std::scoped_lock lock(mutex_);
    const double t = catch_up();
    const bool able = std::ranges::all_of(axes_of(controller), [&](const AxisState& axis) {
        return axis.enabled && !moves(axis, t);
    });
    if (able && alarms_[controller] == StageAlarm::none)
        begin_homing(controller, t);
    else
        fail(StageAlarm::not_ready, controller, t);
}

void SimulatedStage::begin_homing(std::size_t controller, double t) {
    ++motions_;
    double end = t + std::chrono::duration<double>(options_.homing).count();
    for (AxisState& axis : axes_of(controller)) {
        const std::size_t i = index_of(axis);
        axis.claims_arrival = false;
        axis.physics.find_zero(std::clamp(0.0, axes_[i].low, axes_[i].high), axes_[i].speed,
                               drawn_error(i), t);
        end = std::max(end, axis.physics.ends());
        if (axis.jammed && axis.physics.runs(t))
            axis.physics.seize(t);
    }
    for (AxisState& axis : axes_of(controller)) {
        axis.homed = true;
        axis.homing_until = end;
    }
}

int SimulatedStage::reason_to_refuse(const std::vector<double>& target,
                                     const std::vector<double>& speed, std::size_t controller,
                                     double t) {
    const std::span<AxisState> axes = axes_of(controller);
    const bool able = std::ranges::all_of(axes, [&](const AxisState& axis) {
        return axis.enabled && is_homed(axis, t) && !moves(axis, t);
    });
    if (!able || alarms_[controller] != StageAlarm::none)
        return StageAlarm::not_ready;
    if (target.size() != axes.size() || speed.size() != axes.size())
        return StageAlarm::outside_travel;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const Axis& axis = axes_[index_of(axes[i])];
        // Targets come rounded to counts: the last half count beyond a limit is inside.
        const double rounding = axis.kind == Axis::Kind::linear ? 1e-4 : 1e-6;
        const bool inside = target[i] >= axis.low - rounding && target[i] <= axis.high + rounding;
        if (!inside || !(speed[i] > 0.0 && speed[i] <= 1.001 * axis.speed))
            return StageAlarm::outside_travel;
    }
    return StageAlarm::none;
}

void SimulatedStage::start(const std::vector<double>& target, const std::vector<double>& speed,
                           std::size_t controller) {
    const std::scoped_lock lock(mutex_);
    const double t = catch_up();
    const int refused = reason_to_refuse(target, speed, controller, t);
    if (refused != StageAlarm::none) {
        fail(refused, controller, t);
        return;
    }
    ++motions_;
    const std::span<AxisState> axes = axes_of(controller);
    for (std::size_t i = 0; i < axes.size(); ++i) {
        axes[i].claims_arrival = false;
        axes[i].physics.move_to(target[i], speed[i], drawn_error(index_of(axes[i])), t);
        if (axes[i].jammed && axes[i].physics.runs(t))
            axes[i].physics.seize(t);
    }
    ++moves_started_;
    fire(When::move, moves_started_, moves_started_, t);
}

void SimulatedStage::reset(std::size_t controller) {
    now([&](double) {
        if (emergency_stop_)
            return;
        alarms_.at(controller) = StageAlarm::none;
        for (AxisState& axis : axes_of(controller))
            axis.at_limit = false;
    });
}

// ---- reading

std::vector<AxisStatus> SimulatedStage::status() {
    std::unique_lock lock(mutex_);
    const double t = catch_up();
    std::vector<AxisStatus> statuses;
    for (const AxisState& axis : states_)
        statuses.push_back(status_of(axis, t));
    // An axis that lies may be photographed while it moves: the picture follows it.
    const bool lies = std::ranges::any_of(states_, &AxisState::claims_arrival);
    const bool moves = any_moves(states_, t);
    if (!ready_ || (moves && !lies))
        return statuses;
    const auto ready = ready_;
    const std::vector<double> truth = true_positions_at(t);
    lock.unlock();
    if (!ready(truth) && !moves) {
        for (AxisStatus& status : statuses)
            status.in_position = false;
    }
    return statuses;
}

std::vector<double> SimulatedStage::true_positions_at(double t) const {
    const double kelvin = options_.temperature.at(t);
    std::vector<double> positions;
    for (const AxisState& axis : states_)
        positions.push_back(axis.physics.true_position(t, kelvin));
    return with_lean(options_.errors, std::move(positions));
}

std::vector<double> SimulatedStage::target() {
    const std::scoped_lock lock(mutex_);
    std::vector<double> targets;
    for (const AxisState& axis : states_)
        targets.push_back(axis.physics.target());
    return targets;
}

void SimulatedStage::hold_in_position_until(std::function<bool(const std::vector<double>&)> ready) {
    const std::scoped_lock lock(mutex_);
    ready_ = std::move(ready);
}

// ---- faults

void SimulatedStage::jam_at(std::size_t index, double t) {
    AxisState& axis = states_.at(index);
    axis.jammed = true;
    if (axis.physics.runs(t))
        axis.physics.seize(t);
}

void SimulatedStage::hit_limit_at(std::size_t index, double t) {
    AxisState& axis = states_.at(index);
    axis.at_limit = true;
    fail(StageAlarm::limit, axis.controller, t);
}

void SimulatedStage::press_emergency_stop_at(double t) {
    emergency_stop_ = true;
    for (std::size_t c = 0; c < controllers_.size(); ++c) {
        alarms_[c] = StageAlarm::emergency_stop;
        brake(c, t);
    }
    for (AxisState& axis : states_)
        axis.enabled = axis.homed = false;
}

void SimulatedStage::happen(const StageFault& fault, double t) {
    switch (fault.kind) {
        case Fault::stuck_axis:
            return jam_at(fault.axis, t);
        case Fault::false_in_position:
            states_[fault.axis].claims_arrival = true;
            return;
        case Fault::encoder_jump:
            return states_[fault.axis].physics.jump_encoder(fault.size);
        case Fault::limit_hit:
            return hit_limit_at(fault.axis, t);
        case Fault::emergency_stop:
            return press_emergency_stop_at(t);
        case Fault::alarm:
            return fail(fault.code, states_[fault.axis].controller, t);
    }
}

// Every fault that waits for one of the values first to last.
void SimulatedStage::fire(When when, int first, int last, double t) {
    std::vector<StageFault> due;
    std::erase_if(pending_, [&](const StageFault& fault) {
        const bool now = fault.at.when == when && fault.at.value >= first && fault.at.value <= last;
        if (now)
            due.push_back(fault);
        return now;
    });
    for (const StageFault& fault : due)
        happen(fault, t);
}

void SimulatedStage::notice_request(int first_written, int count) {
    const std::scoped_lock lock(mutex_);
    const double t = catch_up();
    ++requests_;
    fire(When::request, requests_, requests_, t);
    if (count > 0)
        fire(When::write_to, first_written, first_written + count - 1, t);
}

void SimulatedStage::jam(std::size_t axis, bool jammed) {
    now([&](double t) {
        if (jammed)
            return jam_at(axis, t);
        states_.at(axis).jammed = false;
    });
}

void SimulatedStage::press_emergency_stop(bool pressed) {
    now([&](double t) {
        if (pressed)
            return press_emergency_stop_at(t);
        emergency_stop_ = false;
    });
}

}  // namespace etalon
