#include "compare/expect/error_intervals.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/statistics/distributions.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

constexpr std::size_t max_groups = 500;
constexpr std::size_t bootstrap_draws = 999;  // 2.5 % of bootstrap_draws + 1 is the whole number 25
constexpr std::uint32_t shuffle_stream = 410, draw_stream = 411;

// Sums over a group of rows; squares are of distances from the mean of all rows, so that no digits
// cancel.
struct Sums {
    double count = 0.0;
    ErrorRow error{}, square{}, absolute{};

    void add_row(const ErrorRow& row, const ErrorRow& mean) {
        count += 1.0;
        for (std::size_t k = 0; k < error_measure_count; ++k) {
            const double distance = row[k] - mean[k];
            error[k] += distance;
            square[k] += distance * distance;
            absolute[k] += std::abs(row[k]);
        }
    }
    void add(const Sums& other) {
        count += other.count;
        for (std::size_t k = 0; k < error_measure_count; ++k) {
            error[k] += other.error[k];
            square[k] += other.square[k];
            absolute[k] += other.absolute[k];
        }
    }
    double mean_distance(std::size_t k) const { return error[k] / count; }
    double deviation(std::size_t k) const {  // needs count > 1
        const double square_of_mean = error[k] * error[k] / count;
        return std::sqrt(std::max(0.0, square[k] - square_of_mean) / (count - 1.0));
    }
    double mean_absolute(std::size_t k) const { return absolute[k] / count; }
};

std::size_t index_below(RandomStream& random, std::size_t bound) {
    return static_cast<std::size_t>((std::uint64_t{random.bits()} * bound) >> 32);
}

// Which group each row belongs to: groups of equal size (but for one) in random order, as
// neighbours in a well-spread sequence of poses are not independent.
std::vector<std::uint32_t> shuffled_groups(std::size_t rows, std::size_t groups,
                                           std::uint64_t seed) {
    std::vector<std::uint32_t> group(rows);
    for (std::size_t i = 0; i < rows; ++i)
        group[i] = static_cast<std::uint32_t>(i % groups);
    RandomStream random(seed, shuffle_stream);
    for (std::size_t i = rows; i > 1; --i)
        std::swap(group[i - 1], group[index_below(random, i)]);
    return group;
}

ErrorRow means(std::span<const ErrorRow> rows) {
    Sums sums;
    for (const ErrorRow& row : rows)
        sums.add_row(row, ErrorRow{});
    ErrorRow mean{};
    for (std::size_t k = 0; k < error_measure_count; ++k)
        mean[k] = sums.mean_distance(k);
    return mean;
}

std::vector<Sums> drawn_sums(std::span<const Sums> groups, std::uint64_t seed) {
    std::vector<Sums> drawn(bootstrap_draws);
    for (std::size_t draw = 0; draw < bootstrap_draws; ++draw) {
        RandomStream random(seed, draw_stream, draw);
        for (std::size_t i = 0; i < groups.size(); ++i)
            drawn[draw].add(groups[index_below(random, groups.size())]);
    }
    return drawn;
}

// The percentiles of one statistic over the bootstrap_draws.
template <typename Statistic>
std::optional<ConfidenceInterval> percentiles(std::span<const Sums> drawn, double offset,
                                              const Statistic& statistic) {
    if (drawn.empty())
        return std::nullopt;
    std::vector<double> values;
    values.reserve(drawn.size());
    for (const Sums& sums : drawn)
        values.push_back(offset + statistic(sums));
    constexpr std::ptrdiff_t rank = (bootstrap_draws + 1) / 40;  // 2.5 %
    const auto low = values.begin() + rank - 1, high = values.end() - rank;
    std::nth_element(values.begin(), low, values.end());
    std::nth_element(low + 1, high, values.end());
    return ConfidenceInterval{*low, *high};
}

ErrorStatistics one_measure(const Sums& total, std::span<const Sums> drawn, double mean,
                            std::size_t k) {
    ErrorStatistics statistics;
    statistics.mean = {
        mean, percentiles(drawn, mean, [k](const Sums& sums) { return sums.mean_distance(k); })};
    if (total.count > 1.0)
        statistics.standard_deviation = {
            total.deviation(k),
            percentiles(drawn, 0.0, [k](const Sums& sums) { return sums.deviation(k); })};
    statistics.mean_absolute = {
        total.mean_absolute(k),
        percentiles(drawn, 0.0, [k](const Sums& sums) { return sums.mean_absolute(k); })};
    return statistics;
}

}  // namespace

MeasureStatistics moment_statistics(std::span<const ErrorRow> rows, std::uint64_t seed) {
    const ErrorRow mean = means(rows);
    std::vector<Sums> groups(std::min(rows.size(), max_groups));
    const std::vector<std::uint32_t> group = shuffled_groups(rows.size(), groups.size(), seed);
    for (std::size_t i = 0; i < rows.size(); ++i)
        groups[group[i]].add_row(rows[i], mean);
    Sums total;
    for (const Sums& sums : groups)
        total.add(sums);
    std::vector<Sums> drawn;
    if (rows.size() >= min_bootstrap_values)
        drawn = drawn_sums(groups, seed);
    MeasureStatistics statistics;
    for (std::size_t k = 0; k < error_measure_count; ++k)
        statistics[k] = one_measure(total, drawn, mean[k], k);
    return statistics;
}

Estimate median_estimate(std::span<double> values) {
    const std::size_t n = values.size();
    const auto at = [&](std::size_t i) { return values.begin() + static_cast<std::ptrdiff_t>(i); };
    const auto middle = at(n / 2);
    std::nth_element(values.begin(), middle, values.end());
    Estimate median{*middle, std::nullopt};
    if (n % 2 == 0)
        median.value = 0.5 * (*middle + *std::max_element(values.begin(), middle));
    if (const auto rank = median_interval_rank(n)) {
        const auto low = at(*rank - 1), high = at(n - *rank);
        std::nth_element(values.begin(), low, middle);
        std::nth_element(middle, high, values.end());
        median.interval = {*low, *high};
    }
    return median;
}

// The number of values below the median is binomial with n and 1/2: the largest rank l with
// P(fewer than l) <= 2.5 %.
std::optional<std::size_t> median_interval_rank(std::size_t n) {
    if (n < 6)
        return std::nullopt;
    return coin_quantile(0.025, n) + 1;
}

}  // namespace etalon
