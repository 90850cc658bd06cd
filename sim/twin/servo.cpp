#include "sim/twin/servo.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/program/errors.h"

namespace etalon {
namespace {

// Times of the first half of a move: jerk, constant acceleration, jerk back; then cruising.
struct Times {
    double jerk = 0.0, constant = 0.0, cruise = 0.0;
    double acceleration = 0.0;  // the largest that is reached
};

Times trapezoid_times(double distance, const MotionLimits& limits) {
    const double peak = std::min(limits.speed, std::sqrt(distance * limits.acceleration));
    Times times{.constant = peak / limits.acceleration, .acceleration = limits.acceleration};
    times.cruise = std::max(0.0, distance / peak - times.constant);
    return times;
}

// Up to the speed v = j T (T + C) over the way v (2 T + C) / 2, with the jerk for T and the
// acceleration a = j T for C; the same way down.
Times s_curve_times(double distance, const MotionLimits& limits) {
    Times times;
    times.jerk = std::min({limits.acceleration / limits.jerk, std::sqrt(limits.speed / limits.jerk),
                           std::cbrt(distance / (2.0 * limits.jerk))});
    const double t = times.jerk, a = limits.jerk * t;
    const double to_speed = limits.speed / a - t;
    const double to_distance = 0.5 * (std::sqrt(t * t + 4.0 * distance / a) - 3.0 * t);
    times.constant = std::max(0.0, std::min(to_speed, to_distance));
    times.cruise =
        std::max(0.0, distance / (a * (t + times.constant)) - (2.0 * t + times.constant));
    times.acceleration = a;
    return times;
}

}  // namespace

MotionPiece MotionPiece::after(double s) const {
    return {duration - s, position + s * (velocity + s * (acceleration / 2.0 + s * jerk / 6.0)),
            velocity + s * (acceleration + s * jerk / 2.0), acceleration + s * jerk, jerk};
}

Motion::Motion(double rest_at) : start_(rest_at), end_(rest_at) {}

void Motion::append(double duration, double acceleration, double jerk) {
    if (!(duration > 0.0))
        return;
    pieces_.push_back({duration, end_, velocity_, acceleration, jerk});
    const MotionPiece last = pieces_.back().after(duration);
    end_ = last.position;
    velocity_ = last.velocity;
    duration_ += duration;
}

Motion Motion::between(double from, double to, const MotionLimits& limits) {
    Motion motion(from);
    const double distance = std::abs(to - from);
    if (!(distance > 0.0))
        return motion;
    const bool s_curve = std::isfinite(limits.jerk);
    const Times times =
        s_curve ? s_curve_times(distance, limits) : trapezoid_times(distance, limits);
    const double sign = to > from ? 1.0 : -1.0;
    const double a = sign * times.acceleration, j = s_curve ? sign * limits.jerk : 0.0;
    motion.append(times.jerk, 0.0, j);
    motion.append(times.constant, a, 0.0);
    motion.append(times.jerk, a, -j);
    motion.append(times.cruise, 0.0, 0.0);
    motion.append(times.jerk, 0.0, -j);
    motion.append(times.constant, -a, 0.0);
    motion.append(times.jerk, -a, j);
    motion.end_ = to;
    return motion;
}

// The acceleration goes to a peak, stays there and comes back to 0; on the way the velocity
// changes by `change`. What an acceleration of 0 at once would leave tells the direction.
Motion Motion::braking(double from, double velocity, double acceleration,
                       const MotionLimits& limits) {
    Motion motion(from);
    motion.velocity_ = velocity;
    if (std::isinf(limits.jerk)) {
        const double a = velocity > 0.0 ? -limits.acceleration : limits.acceleration;
        motion.append(std::abs(velocity) / limits.acceleration, a, 0.0);
        return motion;
    }
    const double left = velocity + acceleration * std::abs(acceleration) / (2.0 * limits.jerk);
    const double sign = left > 0.0 ? -1.0 : 1.0, j = sign * limits.jerk;
    const double now = sign * acceleration, change = -sign * velocity;
    const double free_peak = std::sqrt(std::max(0.0, limits.jerk * change + now * now / 2.0));
    const double peak =
        std::clamp(free_peak, std::max(0.0, now), std::max(limits.acceleration, now));
    const double by_ramps = (2.0 * peak * peak - now * now) / (2.0 * limits.jerk);
    const double up = (peak - now) / limits.jerk;
    const double constant = peak > 0.0 ? (change - by_ramps) / peak : 0.0;
    motion.append(up, acceleration, j);
    motion.append(free_peak > peak ? constant : 0.0, sign * peak, 0.0);
    motion.append(peak / limits.jerk, sign * peak, -j);
    return motion;
}

MotionPiece Motion::at(double t) const {
    if (t < 0.0)
        return {.position = start_};
    for (const MotionPiece& piece : pieces_) {
        if (t < piece.duration)
            return piece.after(t);
        t -= piece.duration;
    }
    return {.position = end_};
}

// By scaling and squaring; the series m + m^2 / 2 + m^3 / 6 + ... by Horner.
SmallMatrix exponential_minus_one(const SmallMatrix& m) {
    constexpr double scaled_norm = 0.5;
    constexpr int taylor_terms = 14;  // 0.5^15 / 15! = 2e-17 of the first
    const double norm = m.cwiseAbs().rowwise().sum().maxCoeff();
    if (!std::isfinite(norm))
        throw NumericalError(fmt::format("no exponential of a matrix of norm {}", norm));
    int squarings = 0;
    std::frexp(norm / scaled_norm, &squarings);
    squarings = std::max(0, squarings);
    const SmallMatrix one = SmallMatrix::Identity(m.rows(), m.cols());
    const SmallMatrix scaled = m * std::ldexp(1.0, -squarings);
    SmallMatrix sum = one;
    for (int k = taylor_terms; k >= 2; --k)
        sum = one + (scaled * sum / k).eval();
    SmallMatrix e = scaled * sum;
    for (int k = 0; k < squarings; ++k)
        e = (2.0 * e + e * e).eval();  // (1 + e)^2 - 1
    if (!e.allFinite())
        throw NumericalError("an exponential that overflows: the dynamics are not stable");
    return e;
}

// Speeds are kept divided by their natural frequency, so that every row of A is as large as the
// rate of its part.
Servo::Servo(const ServoParameters& p) {
    const auto require = [](bool holds, const char* name, double value) {
        if (!holds || !std::isfinite(value))
            throw NumericalError(fmt::format("servo: {} = {} is out of its range", name, value));
    };
    require(p.drive_lag >= 0.0, "drive lag, s,", p.drive_lag);
    require(p.bandwidth_hz > 0.0, "bandwidth, Hz,", p.bandwidth_hz);
    require(p.damping > 0.0, "damping", p.damping);
    require(p.resonance_hz >= 0.0, "resonance, Hz,", p.resonance_hz);
    require(p.resonance_damping > 0.0, "resonance damping", p.resonance_damping);
    const bool lags = p.drive_lag > 0.0, rings = p.resonance_hz > 0.0;
    motor_ = lags ? 1 : 0;
    carriage_ = rings ? motor_ + 2 : motor_;
    const Eigen::Index states = carriage_ + 2, e = motor_, c = carriage_;
    SmallMatrix& a = a_ = SmallMatrix::Zero(states, states);
    SmallVector& b = b_ = SmallVector::Zero(states);
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

// In units of the step: u = u_0 + u_1 s + u_2 s^2/2 + u_3 s^3/6, s from 0 to 1, is a chain of
// four states of which each is the derivative of the one before.
Servo::State Servo::advance(const State& state, const MotionPiece& piece, double seconds) const {
    const Eigen::Index n = state.size();
    const double h = seconds;
    SmallMatrix m = SmallMatrix::Zero(n + 4, n + 4);
    m.topLeftCorner(n, n) = h * a_;
    m.block(0, n, n, 1) = h * b_;
    for (Eigen::Index i = n; i < n + 3; ++i)
        m(i, i + 1) = 1.0;
    SmallVector whole(n + 4);
    whole << state, piece.position, h * piece.velocity, h * h * piece.acceleration,
        h * h * h * piece.jerk;
    return state + (exponential_minus_one(m) * whole).head(n);
}

Servo::State Servo::at_rest(double position) const {
    State state = State::Zero(b_.size());
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
            now = advance(now, piece.after(first - start), last - first);
        start = end;
    }
    if (const double first = std::max(from, start); first < to)
        now = advance(now, {.position = motion.end()}, to - first);
    return now;
}

}  // namespace etalon
