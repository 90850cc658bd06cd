// Roots of functions of one number, as the projections of calib/camera/lens_projection.h need them.
#pragma once

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

// The smallest x > 0 at which c0 + c1 x + c2 x^2 + ... is no longer positive; infinity where there
// is none, 0 where it is not positive at 0. To rounding, unless two roots nearly coincide. Up to
// degree 4.
double first_positive_root(std::initializer_list<double> coefficients);

}  // namespace etalon
