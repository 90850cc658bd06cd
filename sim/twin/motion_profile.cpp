#include "sim/twin/motion_profile.h"

#include <algorithm>
#include <cmath>

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

double Motion::position(double t) const {
    return at(t).position;
}

double Motion::velocity(double t) const {
    return at(t).velocity;
}

double Motion::acceleration(double t) const {
    return at(t).acceleration;
}

}  // namespace etalon
