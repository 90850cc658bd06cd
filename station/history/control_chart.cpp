#include "station/history/control_chart.h"

#include <fmt/format.h>

#include <cmath>

#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

// Normal with the tail probability of Student's t. A tail below 1e-13
// counts as 7.35 deviations, far outside of any limit.
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
