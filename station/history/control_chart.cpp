#include "station/history/control_chart.h"

#include <fmt/format.h>

#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

constexpr std::size_t most_runs = 400, most_exact = 60;
constexpr double days_per_year = 365.25;

int sign(double value) {
    return (value > 0.0) - (value < 0.0);
}

// The chance of each number of inversions of n values in random order: the k-th value has 0 to
// k - 1 of those before it above it, each as likely.
std::vector<double> inversion_probabilities(std::size_t n) {
    std::vector<double> chances = {1.0};
    for (std::size_t k = 2; k <= n; ++k) {
        std::vector<double> next(chances.size() + k - 1, 0.0);
        for (std::size_t i = 0; i < chances.size(); ++i)
            for (std::size_t below = 0; below < k; ++below)
                next[i + below] += chances[i] / static_cast<double>(k);
        chances = std::move(next);
    }
    return chances;
}

double exact_probability(std::size_t n, long s) {
    const std::vector<double> chances = inversion_probabilities(n);
    const auto pairs = static_cast<long>(n * (n - 1) / 2);
    double probability = 0.0;
    for (long inversions = 0; inversions <= pairs; ++inversions)
        if (std::abs(pairs - 2 * inversions) >= std::abs(s))
            probability += chances[static_cast<std::size_t>(inversions)];
    return std::min(1.0, probability);
}

double normal_approximation(std::size_t n, long s) {
    const auto runs = static_cast<double>(n);
    const double deviation = std::sqrt(runs * (runs - 1.0) * (2.0 * runs + 5.0) / 18.0);
    const double beyond = std::max(0.0, static_cast<double>(std::abs(s)) - 1.0);
    return 2.0 * normal_probability(-beyond / deviation);
}

// Normal of the same tail probability; below 1e-13 it is 7.35 deviations, beyond any limit.
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

Trend trend_of(std::span<const TimedValue> values) {
    if (values.size() > most_runs)
        values = values.last(most_runs);
    long s = 0;
    std::vector<double> slopes;
    for (std::size_t j = 0; j < values.size(); ++j) {
        if (!std::isfinite(values[j].value) || !std::isfinite(values[j].day))
            throw NumericalError(fmt::format("trend: a value is {}", values[j].value));
        for (std::size_t i = 0; i < j; ++i) {
            const double rise = values[j].value - values[i].value;
            const double days = values[j].day - values[i].day;
            s += sign(rise);
            if (days > 0.0)
                slopes.push_back(rise / days * days_per_year);
        }
    }
    Trend trend;
    trend.runs = static_cast<int>(values.size());
    if (values.size() >= 2)
        trend.probability = values.size() <= most_exact ? exact_probability(values.size(), s)
                                                        : normal_approximation(values.size(), s);
    if (!slopes.empty())
        trend.per_year = median(std::move(slopes));
    return trend;
}

double trend_limit(int quantities) {
    return trend_false_alarm / std::max(1, quantities);
}

bool is_too_short_for_trend(int runs, int quantities) {
    return 2.0 / std::tgamma(runs + 1.0) > trend_limit(quantities);
}

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
