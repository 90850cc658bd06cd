#include "station/history/control_chart.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "core/errors.h"
#include "core/student_t.h"

namespace etalon {
namespace {

// The z with P(Z > z) = upper_tail of the standard normal distribution, by Newton's method on the
// logarithm of the tail, which is nearly a parabola. 1e-300 < upper_tail <= 0.5.
double normal_quantile(double upper_tail) {
    double z = 0.0;
    for (int i = 0; i < 60; ++i) {
        const double tail = 0.5 * std::erfc(z / std::numbers::sqrt2);
        const double density = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::numbers::pi);
        const double step = std::log(tail / upper_tail) * tail / density;
        z += step;
        if (std::abs(step) < 1e-14 * (1.0 + z))
            break;
    }
    return z;
}

// Normal with the tail probability of Student's t. Beyond 1e-13 the tail is lost in rounding: such
// a value counts as 7.35 deviations, far outside of any limit.
double normal_from_student(double t, int degrees_of_freedom) {
    constexpr double smallest = 1e-13;
    const double tail = student_t_probability(-std::abs(t), degrees_of_freedom);
    return std::copysign(normal_quantile(std::max(tail, smallest)), t);
}

// Welford's running mean and sum of squares.
struct Moments {
    int count = 0;
    double mean = 0.0, squares = 0.0;

    void add(double value) {
        ++count;
        const double from_mean = value - mean;
        mean += from_mean / count;
        squares += from_mean * (value - mean);
    }
    double deviation() const { return std::sqrt(squares / (count - 1)); }
};

std::optional<double> q_of(double value, const Moments& before) {
    if (before.count < 2 || !(before.squares > 0.0))
        return std::nullopt;
    const double n = before.count;
    const double t = (value - before.mean) / (before.deviation() * std::sqrt((n + 1.0) / n));
    return normal_from_student(t, before.count - 1);
}

}  // namespace

std::vector<ChartPoint> drift_chart(std::span<const double> values) {
    std::vector<ChartPoint> points;
    Moments before;
    std::optional<double> ewma;
    for (const double value : values) {
        if (!std::isfinite(value))
            throw NumericalError(fmt::format("control chart: a value is {}", value));
        ChartPoint point;
        point.q = q_of(value, before);
        if (point.q)
            ewma = drift_weight * *point.q + (1.0 - drift_weight) * ewma.value_or(0.0);
        point.ewma = ewma;
        point.alarm = ewma && std::abs(*ewma) > drift_limit;
        points.push_back(point);
        before.add(value);
    }
    return points;
}

}  // namespace etalon
