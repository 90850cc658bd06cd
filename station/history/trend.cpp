#include "station/history/trend.h"

#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "core/program/errors.h"
#include "core/statistics/distributions.h"
#include "core/statistics/median.h"

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

}  // namespace etalon
