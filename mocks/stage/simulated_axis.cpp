#include "mocks/stage/simulated_axis.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace etalon {
namespace {

bool is_usable(const AxisErrors& e) {
    const bool signed_ones_finite =
        std::isfinite(e.scale + e.periodic + e.phase + e.expansion + e.drift);
    const bool others_finite =
        std::isfinite(e.repeatability + e.backlash + e.period + e.encoder_noise);
    return signed_ones_finite && others_finite && e.repeatability >= 0.0 && e.backlash >= 0.0 &&
           e.period > 0.0 && e.encoder_noise >= 0.0;
}

void require_lean(const std::vector<Axis>& axes, std::size_t axis,
                  const std::vector<double>& lean) {
    const SourcePlace place{"simulated stage"};
    if (!lean.empty() && lean.size() != axes.size())
        throw ConfigError(place, fmt::format("axis '{}': lean towards {} of {} axes",
                                             axes[axis].name, lean.size(), axes.size()));
    for (std::size_t i = 0; i < lean.size(); ++i) {
        const bool possible = i != axis && axes[axis].kind == Axis::Kind::linear &&
                              axes[i].kind == Axis::Kind::linear && std::isfinite(lean[i]);
        if (lean[i] != 0.0 && !possible)
            throw ConfigError(place, fmt::format("axis '{}' cannot lean towards '{}'",
                                                 axes[axis].name, axes[i].name));
    }
}

double error_on_map(const ErrorMap& map, double motor) {
    const auto& points = map.points();
    return map.at(std::clamp(motor, points.front().position, points.back().position))->error;
}

}  // namespace

double StageTemperature::at(double seconds) const {
    return seconds > 0.0 ? -change * std::expm1(-seconds / time_constant) : 0.0;
}

double error_at(const AxisErrors& errors, double motor, double kelvin) {
    const double turns = motor / errors.period;
    const double mapped = errors.map ? error_on_map(*errors.map, motor) : 0.0;
    return mapped + motor * (errors.scale + errors.expansion * kelvin) + errors.drift * kelvin +
           errors.periodic * std::sin(2.0 * std::numbers::pi * turns + errors.phase);
}

std::vector<double> with_lean(const std::vector<AxisErrors>& errors,
                              std::vector<double> positions) {
    const std::vector<double> upright = positions;
    for (std::size_t from = 0; from < errors.size(); ++from)
        for (std::size_t to = 0; to < errors[from].lean.size(); ++to)
            positions[to] += errors[from].lean[to] * upright[from];
    return positions;
}

double play_after(double play, double way, double backlash) {
    return std::clamp(play - way, 0.0, backlash);
}

void require_usable(const std::vector<AxisErrors>& errors, const std::vector<Axis>& axes) {
    const SourcePlace place{"simulated stage"};
    if (errors.size() != axes.size())
        throw ConfigError(place,
                          fmt::format("{} axis errors for {} axes", errors.size(), axes.size()));
    for (std::size_t i = 0; i < axes.size(); ++i) {
        if (!is_usable(errors[i]))
            throw ConfigError(place, fmt::format("axis '{}': errors out of range", axes[i].name));
        require_lean(axes, i, errors[i].lean);
    }
}

SimulatedAxis::SimulatedAxis(const AxisDynamics& dynamics, const AxisErrors& errors, double rest_at)
    : dynamics_(dynamics), errors_(errors), motion_(rest_at), target_(rest_at) {
    if (dynamics.servo) {
        servo_.emplace(dynamics.servo->parameters);
        state_ = servo_->at_rest(rest_at);
    }
}

// The state of everything that has a memory at t becomes the new beginning.
void SimulatedAxis::plan(const Motion& motion, double drawn_after, double t) {
    if (servo_)
        state_ = servo_state(t);
    play_ = play(t);
    drawn_before_ = drawn(t);
    drawn_after_ = drawn_after;
    motion_ = motion;
    started_ = t;
    stuck_ = false;
}

void SimulatedAxis::move_to(double target, double speed, double drawn_error, double t) {
    const double from = motion_.end(), to = target - encoder_offset_;
    target_ = target;
    plan(Motion::between(from, to, {speed, dynamics_.acceleration, dynamics_.jerk}),
         to == from ? drawn(t) : drawn_error, t);
}

void SimulatedAxis::find_zero(double zero, double speed, double drawn_error, double t) {
    encoder_offset_ = 0.0;
    move_to(zero, speed, drawn_error, t);
}

void SimulatedAxis::brake(double t) {
    const double s = since_start(t);
    plan(Motion::braking(motion_.position(s), motion_.velocity(s), motion_.acceleration(s),
                         {1.0, dynamics_.acceleration, dynamics_.jerk}),
         drawn(t), t);
}

void SimulatedAxis::seize(double t) {
    plan(Motion(motor(t)), drawn(t), t);
    if (servo_)
        state_ = servo_->with_motor_stopped(state_);
    stuck_ = true;
}

bool SimulatedAxis::runs(double t) const {
    return stuck_ || since_start(t) < motion_.duration();
}

bool SimulatedAxis::is_at_target(double t) const {
    constexpr double rounding = 1e-9;
    const double window = dynamics_.servo ? dynamics_.servo->window : rounding;
    return std::abs(encoder(t) - target_) <= window;
}

Servo::State SimulatedAxis::servo_state(double t) const {
    return servo_->advance(state_, motion_, 0.0, since_start(t));
}

double SimulatedAxis::motor(double t) const {
    return servo_ ? servo_->motor(servo_state(t)) : motion_.position(since_start(t));
}

double SimulatedAxis::encoder(double t) const {
    return motor(t) + encoder_offset_;
}

double SimulatedAxis::play(double t) const {
    return play_after(play_, motion_.position(since_start(t)) - motion_.start(), errors_.backlash);
}

double SimulatedAxis::drawn(double t) const {
    const double way = motion_.end() - motion_.start();
    const double done =
        way == 0.0 ? 1.0 : (motion_.position(since_start(t)) - motion_.start()) / way;
    return drawn_before_ + done * (drawn_after_ - drawn_before_);
}

double SimulatedAxis::true_position(double t, double kelvin) const {
    const double carriage =
        servo_ ? servo_->carriage(servo_state(t)) : motion_.position(since_start(t));
    return carriage + error_at(errors_, carriage, kelvin) + drawn(t) + play(t);
}

}  // namespace etalon
