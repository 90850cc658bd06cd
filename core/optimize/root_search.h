// Roots of functions of one number and of maps of the plane, for the projections of calib/camera.
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <optional>

namespace etalon {

struct ValueAndSlope {
    double value, slope;
};

// Where a function that is below zero at 0 rises through zero, between 0 and `limit` (which may be
// infinite): Newton's method from `start`, and bisection where a step would leave the bracket.
// Right to rounding. Nothing when it does not reach zero.
template <class Function>
std::optional<double> rising_root(const Function& f, double limit, double start) {
    constexpr int most_steps = 200;
    constexpr double farthest = 1e150;
    double low = 0.0, high = start > 0.0 && start < limit ? start : 0.5 * limit;
    if (!std::isfinite(high))
        high = 1.0;
    while (!(f(high).value >= 0.0)) {
        low = high;
        high = std::isfinite(limit) ? high + 0.5 * (limit - high) : 2.0 * high;
        if (!(high < farthest) || !(high > low))
            return std::nullopt;
    }
    double x = high;
    for (int step = 0; step < most_steps; ++step) {
        const ValueAndSlope at = f(x);
        if (at.value == 0.0)
            return x;
        (at.value < 0.0 ? low : high) = x;
        const double newton = x - at.value / at.slope;
        const double next = newton > low && newton < high ? newton : 0.5 * (low + high);
        if (!(next > low && next < high) || std::abs(next - x) <= 1e-16 * std::abs(x))
            return next;
        x = next;
    }
    return x;
}

// The smallest x > 0 at which c0 + c1 x + c2 x^2 + ... (degree 4 at most) is not positive; infinity
// for none, 0 where it is not positive at 0. To rounding, unless two roots nearly coincide.
double first_positive_root(std::initializer_list<double> coefficients);

// The point of a plane that a smooth map takes to a target: Newton's method, damped so that every
// step comes nearer, inside a region in which the map is invertible (`contains`). `map` gives
// `point`, `jacobian` and is_regular(). Right to 1e-12 of `scale`, asked for to 1e-14; nothing
// where no such point is found.
template <class Map, class Contains>
std::optional<Eigen::Vector2d> damped_newton(const Map& map, const Contains& contains,
                                             const Eigen::Vector2d& target,
                                             const Eigen::Vector2d& start, double scale) {
    constexpr double tolerance = 1e-12;       // asked of the result
    constexpr double stop_tolerance = 1e-14;  // at which no further step is worth its time
    Eigen::Vector2d x = start;
    auto at = map(x);
    double error = (target - at.point).norm();
    for (int i = 0; i < 60 && error > stop_tolerance * scale; ++i) {
        const Eigen::Vector2d step = at.jacobian.inverse() * (target - at.point);
        bool advanced = false;
        for (double part = 1.0; part > 1e-6 && !advanced; part *= 0.5) {
            const Eigen::Vector2d next = x + part * step;
            if (!contains(next))
                continue;
            const auto there = map(next);
            const double next_error = (target - there.point).norm();
            if (!there.is_regular() || !(next_error < error)) {
                if (error <= tolerance * scale)
                    break;  // rounding is all that is left
                continue;
            }
            x = next;
            at = there;
            error = next_error;
            advanced = true;
        }
        if (!advanced)
            break;
    }
    if (!(error <= tolerance * scale) || !contains(x) || !at.is_regular())
        return std::nullopt;
    return x;
}

}  // namespace etalon
