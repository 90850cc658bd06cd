#include "sim/twin/servo.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "core/program/errors.h"

namespace etalon {
namespace {

void require(bool holds, const char* name, double value) {
    if (!holds || !std::isfinite(value))
        throw NumericalError(fmt::format("servo: {} = {} is out of its range", name, value));
}

void require_meaningful(const ServoParameters& p) {
    require(p.drive_lag >= 0.0, "drive lag, s,", p.drive_lag);
    require(p.bandwidth_hz > 0.0, "bandwidth, Hz,", p.bandwidth_hz);
    require(p.damping > 0.0, "damping", p.damping);
    require(p.resonance_hz >= 0.0, "resonance, Hz,", p.resonance_hz);
    require(p.resonance_damping > 0.0, "resonance damping", p.resonance_damping);
}

}  // namespace

// Speeds are kept divided by their natural frequency, so that every row of A is as large as the
// rate of its part.
Servo::Servo(const ServoParameters& p) {
    require_meaningful(p);
    const bool lags = p.drive_lag > 0.0, rings = p.resonance_hz > 0.0;
    motor_ = lags ? 1 : 0;
    carriage_ = rings ? motor_ + 2 : motor_;
    const Eigen::Index states = carriage_ + 2, e = motor_, c = carriage_;
    SmallMatrix& a = dynamics_.a = SmallMatrix::Zero(states, states);
    SmallVector& b = dynamics_.b = SmallVector::Zero(states);
    const double ws = 2.0 * std::numbers::pi * p.bandwidth_hz;
    const double wr = 2.0 * std::numbers::pi * p.resonance_hz;
    a(e, e + 1) = ws;
    a(e + 1, e) = -ws;
    a(e + 1, e + 1) = -2.0 * p.damping * ws;
    if (lags) {
        a(0, 0) = -1.0 / p.drive_lag;
        b(0) = 1.0 / p.drive_lag;
        a(e + 1, 0) = ws;
    } else {
        b(e + 1) = ws;
    }
    if (rings) {
        a(c, c + 1) = wr;
        a(c + 1, e) = wr;
        a(c + 1, e + 1) = 2.0 * p.resonance_damping * ws;
        a(c + 1, c) = -wr;
        a(c + 1, c + 1) = -2.0 * p.resonance_damping * wr;
    }
}

Servo::State Servo::at_rest(double position) const {
    State state = State::Zero(dynamics_.b.size());
    if (motor_ > 0)
        state(0) = position;
    state(motor_) = state(carriage_) = position;
    return state;
}

Servo::State Servo::with_motor_stopped(State state) const {
    if (motor_ > 0)
        state(0) = state(motor_);
    state(motor_ + 1) = 0.0;
    return state;
}

Servo::State Servo::advance(const State& state, const Motion& motion, double from,
                            double to) const {
    State now = state;
    double start = 0.0;
    for (const MotionPiece& piece : motion.pieces()) {
        const double end = start + piece.duration;
        const double first = std::max(from, start), last = std::min(to, end);
        if (first < last)
            now = dynamics_.advance(now, piece.after(first - start), last - first);
        start = end;
    }
    if (const double first = std::max(from, start); first < to)
        now = dynamics_.advance(now, {.position = motion.end()}, to - first);
    return now;
}

double Servo::motor(const State& state) const {
    return state(motor_);
}

double Servo::carriage(const State& state) const {
    return state(carriage_);
}

}  // namespace etalon
