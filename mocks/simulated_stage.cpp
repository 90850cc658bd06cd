#include "mocks/simulated_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/random.h"

namespace etalon {
namespace {

void require_options(const std::vector<Axis>& axes, const SimulatedStageOptions& options) {
    const SourcePlace place{"simulated stage"};
    if (axes.empty())
        throw ConfigError(place, "needs at least one axis");
    if (!options.errors.empty() && options.errors.size() != axes.size())
        throw ConfigError(
            place, fmt::format("{} axis errors for {} axes", options.errors.size(), axes.size()));
    for (const AxisErrors& errors : options.errors) {
        if (!std::isfinite(errors.scale) || !std::isfinite(errors.backlash) ||
            !(errors.repeatability >= 0.0 && std::isfinite(errors.repeatability)))
            throw ConfigError(place, "axis errors must be finite, repeatability not negative");
    }
    if (!options.power_on_position.empty())
        require_within_limits(axes, options.power_on_position, place);
    if (options.ramp.count() <= 0 || options.homing.count() < 0)
        throw ConfigError(place, "the ramp must be longer than 0 ms, homing not negative");
}

}  // namespace

TrapezoidalMotion TrapezoidalMotion::between(double from, double to, double speed,
                                             double acceleration) {
    TrapezoidalMotion motion;
    motion.from_ = from;
    motion.to_ = to;
    const double distance = std::abs(to - from);
    const double peak = std::min(speed, std::sqrt(distance * acceleration));
    if (!(peak > 0.0))
        return motion;
    motion.peak_velocity_ = to > from ? peak : -peak;
    motion.ramp_up_ = motion.ramp_down_ = peak / acceleration;
    motion.cruise_ = std::max(0.0, distance / peak - motion.ramp_up_);
    return motion;
}

TrapezoidalMotion TrapezoidalMotion::braking(double from, double velocity, double acceleration) {
    TrapezoidalMotion motion;
    motion.from_ = from;
    motion.peak_velocity_ = velocity;
    motion.ramp_down_ = std::abs(velocity) / acceleration;
    motion.to_ = from + 0.5 * velocity * motion.ramp_down_;
    return motion;
}

double TrapezoidalMotion::position(double t) const {
    if (t <= 0.0)
        return from_;
    if (t >= duration())
        return to_;
    if (t < ramp_up_)
        return from_ + 0.5 * peak_velocity_ * t * t / ramp_up_;
    if (t < ramp_up_ + cruise_)
        return from_ + peak_velocity_ * (t - 0.5 * ramp_up_);
    const double left = duration() - t;
    return to_ - 0.5 * peak_velocity_ * left * left / ramp_down_;
}

double TrapezoidalMotion::velocity(double t) const {
    if (t < 0.0 || t >= duration())
        return 0.0;
    if (t < ramp_up_)
        return peak_velocity_ * t / ramp_up_;
    if (t < ramp_up_ + cruise_)
        return peak_velocity_;
    return peak_velocity_ * (duration() - t) / ramp_down_;
}

SimulatedStage::SimulatedStage(std::vector<Axis> axes, SimulatedStageOptions options, Clock& clock)
    : axes_(std::move(axes)),
      options_(std::move(options)),
      clock_(clock),
      states_(axes_.size()),
      motion_start_(clock.now()) {
    require_options(axes_, options_);
    options_.errors.resize(axes_.size());
    options_.power_on_position.resize(axes_.size(), 0.0);
    for (std::size_t i = 0; i < axes_.size(); ++i) {
        const double rest = options_.power_on_position[i];
        states_[i].motion = TrapezoidalMotion::between(rest, rest, 1.0, 1.0);
        states_[i].target = rest;
    }
}

double SimulatedStage::seconds_since_start(Instant now) const {
    return std::chrono::duration<double>(now - motion_start_).count();
}

double SimulatedStage::acceleration(std::size_t axis) const {
    return axes_[axis].speed / std::chrono::duration<double>(options_.ramp).count();
}

double SimulatedStage::encoder(const AxisState& axis, double t) const {
    return axis.motion.position(t);
}

bool SimulatedStage::moves(const AxisState& axis, double t) const {
    return axis.stuck_now || t < axis.motion.duration() || t < homing_seconds_;
}

bool SimulatedStage::any_moves(double t) const {
    return std::ranges::any_of(states_, [&](const AxisState& axis) { return moves(axis, t); });
}

double SimulatedStage::offset(const AxisState& axis, double t) const {
    const double way = axis.motion.end() - axis.motion.start();
    const double done = way == 0.0 ? 1.0 : (encoder(axis, t) - axis.motion.start()) / way;
    return axis.offset_before + done * (axis.offset_after - axis.offset_before);
}

// Restarts the time of all axes, which all rest or brake from here on.
void SimulatedStage::brake() {
    const Instant now = clock_.now();
    const double t = seconds_since_start(now);
    if (!is_homed(t))
        homed_ = false;
    for (std::size_t i = 0; i < states_.size(); ++i) {
        AxisState& axis = states_[i];
        const double held = offset(axis, t);
        axis.motion =
            TrapezoidalMotion::braking(encoder(axis, t), axis.motion.velocity(t), acceleration(i));
        axis.offset_before = axis.offset_after = held;
        axis.stuck_now = false;
    }
    motion_start_ = now;
    homing_seconds_ = 0.0;
}

// From rest; the caller restarts the time.
void SimulatedStage::begin(std::size_t index, double target, double speed) {
    AxisState& axis = states_[index];
    const double from = axis.motion.end();
    axis.target = target;
    axis.offset_before = axis.offset_after;
    axis.stuck_now = axis.jammed && target != from;
    if (axis.stuck_now || target == from) {
        axis.motion = TrapezoidalMotion::braking(from, 0.0, 1.0);
        return;
    }
    const AxisErrors& errors = options_.errors[index];
    RandomStream random(options_.seed, static_cast<std::uint32_t>(index), moves_started_);
    axis.offset_after =
        errors.repeatability * random.normal() + (target < from ? errors.backlash : 0.0);
    axis.motion = TrapezoidalMotion::between(from, target, speed, acceleration(index));
}

bool SimulatedStage::is_homed(double t) const {
    return homed_ && t >= homing_seconds_;
}

void SimulatedStage::enable(bool on) {
    const std::scoped_lock lock(mutex_);
    if (enabled_ && !on) {
        brake();
        homed_ = false;
    }
    enabled_ = on;
}

void SimulatedStage::home() {
    const std::scoped_lock lock(mutex_);
    const Instant now = clock_.now();
    if (!enabled_ || alarm_ != StageAlarm::none || any_moves(seconds_since_start(now))) {
        fail(StageAlarm::not_ready);
        return;
    }
    ++moves_started_;
    for (std::size_t i = 0; i < axes_.size(); ++i)
        begin(i, std::clamp(0.0, axes_[i].low, axes_[i].high), axes_[i].speed);
    motion_start_ = now;
    homing_seconds_ = std::chrono::duration<double>(options_.homing).count();
    for (const AxisState& axis : states_)
        homing_seconds_ = std::max(homing_seconds_, axis.motion.duration());
    homed_ = true;  // once the homing time has passed, see is_homed()
}

int SimulatedStage::reason_to_refuse(const std::vector<double>& target,
                                     const std::vector<double>& speed, double t) const {
    if (!enabled_ || !is_homed(t) || alarm_ != StageAlarm::none || any_moves(t))
        return StageAlarm::not_ready;
    if (target.size() != axes_.size() || speed.size() != axes_.size())
        return StageAlarm::outside_travel;
    for (std::size_t i = 0; i < axes_.size(); ++i) {
        // Targets come rounded to counts: the last half count beyond a limit is inside.
        const double rounding = axes_[i].kind == Axis::Kind::linear ? 1e-4 : 1e-6;
        const bool inside =
            target[i] >= axes_[i].low - rounding && target[i] <= axes_[i].high + rounding;
        if (!inside || !(speed[i] > 0.0 && speed[i] <= 1.001 * axes_[i].speed))
            return StageAlarm::outside_travel;
    }
    return StageAlarm::none;
}

void SimulatedStage::start(const std::vector<double>& target, const std::vector<double>& speed) {
    const std::scoped_lock lock(mutex_);
    const Instant now = clock_.now();
    const int refused = reason_to_refuse(target, speed, seconds_since_start(now));
    if (refused != StageAlarm::none) {
        fail(refused);
        return;
    }
    ++moves_started_;
    for (std::size_t i = 0; i < axes_.size(); ++i)
        begin(i, target[i], speed[i]);
    motion_start_ = now;
    homing_seconds_ = 0.0;
}

void SimulatedStage::stop() {
    const std::scoped_lock lock(mutex_);
    brake();
}

void SimulatedStage::reset() {
    const std::scoped_lock lock(mutex_);
    alarm_ = StageAlarm::none;
}

// An alarm that is there already is the cause and stays.
void SimulatedStage::fail(int code) {
    if (alarm_ == StageAlarm::none)
        alarm_ = code;
    brake();
}

void SimulatedStage::raise_alarm(int code) {
    const std::scoped_lock lock(mutex_);
    fail(code);
}

void SimulatedStage::jam(std::size_t axis, bool jammed) {
    const std::scoped_lock lock(mutex_);
    AxisState& state = states_.at(axis);
    const double t = seconds_since_start(clock_.now());
    if (jammed && t < state.motion.duration()) {
        const double held = offset(state, t);
        state.motion = TrapezoidalMotion::braking(encoder(state, t), 0.0, 1.0);
        state.offset_before = state.offset_after = held;
        state.stuck_now = true;
    }
    state.jammed = jammed;
}

std::vector<AxisStatus> SimulatedStage::status() const {
    std::unique_lock lock(mutex_);
    const double t = seconds_since_start(clock_.now());
    std::vector<AxisStatus> statuses;
    for (const AxisState& axis : states_) {
        AxisStatus status{enabled_, is_homed(t), moves(axis, t)};
        status.alarm = alarm_;
        status.position = encoder(axis, t);
        status.in_position = enabled_ && !status.moving && status.position == axis.target;
        statuses.push_back(status);
    }
    if (!ready_ || any_moves(t))
        return statuses;
    const auto ready = ready_;
    const std::vector<double> truth = true_positions_at(t);
    lock.unlock();
    if (!ready(truth)) {
        for (AxisStatus& status : statuses)
            status.in_position = false;
    }
    return statuses;
}

std::vector<double> SimulatedStage::true_positions_at(double t) const {
    std::vector<double> positions;
    for (std::size_t i = 0; i < states_.size(); ++i)
        positions.push_back(encoder(states_[i], t) * (1.0 + options_.errors[i].scale) +
                            offset(states_[i], t));
    return positions;
}

std::vector<double> SimulatedStage::true_positions() const {
    const std::scoped_lock lock(mutex_);
    return true_positions_at(seconds_since_start(clock_.now()));
}

bool SimulatedStage::is_moving() const {
    const std::scoped_lock lock(mutex_);
    return any_moves(seconds_since_start(clock_.now()));
}

std::vector<double> SimulatedStage::target() const {
    const std::scoped_lock lock(mutex_);
    std::vector<double> targets;
    for (const AxisState& axis : states_)
        targets.push_back(axis.target);
    return targets;
}

void SimulatedStage::hold_in_position_until(std::function<bool(const std::vector<double>&)> ready) {
    const std::scoped_lock lock(mutex_);
    ready_ = std::move(ready);
}

}  // namespace etalon
