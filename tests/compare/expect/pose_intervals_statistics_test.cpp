#include "compare/expect/pose_statistics.h"
#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

// What is true of a distribution of errors.
struct Truth {
    double mean, deviation, mean_absolute, median, median_absolute;
};

double upper_normal(double x) {
    return 0.5 * std::erfc(x / std::numbers::sqrt2);
}

// By bisection of P(|e| < m) = 1/2 for a normal error.
double folded_median(double mean, double deviation) {
    double low = 0.0, high = 10.0 * deviation;
    for (int i = 0; i < 60; ++i) {
        const double m = 0.5 * (low + high);
        const double inside =
            upper_normal((-m - mean) / deviation) - upper_normal((m - mean) / deviation);
        (inside < 0.5 ? low : high) = m;
    }
    return low;
}

// Normal, mean 1.5, deviation 2; exponential, mean 1; uniform from -1 to 3.
std::array<Truth, 3> truths() {
    const double mean = 1.5, s = 2.0, ratio = mean / s;
    const double folded = s * std::sqrt(2.0 / std::numbers::pi) * std::exp(-0.5 * ratio * ratio) +
                          mean * (1.0 - 2.0 * upper_normal(ratio));
    return {{{mean, s, folded, mean, folded_median(mean, s)},
             {1.0, 1.0, 1.0, std::numbers::ln2, std::numbers::ln2},
             {1.0, 4.0 / std::sqrt(12.0), 1.25, 1.0, 1.0}}};
}

DetectorErrors drawn(int poses, std::uint32_t repetition) {
    RandomStream random(17, 5, repetition);
    DetectorErrors errors(static_cast<std::size_t>(poses));
    for (auto& each : errors) {
        each.emplace();
        each->measures[0] = 1.5 + 2.0 * random.normal();
        each->measures[1] = -std::log(random.uniform());
        each->measures[2] = -1.0 + 4.0 * random.uniform();
    }
    return errors;
}

bool covers(const Estimate& estimate, double truth) {
    return estimate.interval->low <= truth && truth <= estimate.interval->high;
}

using Counts = std::array<std::array<int, 5>, 3>;  // by distribution and statistic

Counts covering(int poses, int repetitions) {
    const std::array<Truth, 3> truth = truths();
    Counts counts{};
    for (int i = 0; i < repetitions; ++i) {
        const auto index = static_cast<std::uint32_t>(i);
        const PoseStatistics statistics = pose_statistics(drawn(poses, index), index);
        for (std::size_t k = 0; k < truth.size(); ++k) {
            const ErrorStatistics& one = (*statistics.all)[k];
            counts[k][0] += covers(one.mean, truth[k].mean);
            counts[k][1] += covers(*one.standard_deviation, truth[k].deviation);
            counts[k][2] += covers(one.mean_absolute, truth[k].mean_absolute);
            counts[k][3] += covers(one.median, truth[k].median);
            counts[k][4] += covers(one.median_absolute, truth[k].median_absolute);
        }
    }
    return counts;
}

// 95 % of 400 repetitions scatter by sqrt(0.95 0.05 / 400) = 1.09 %. Thirty shares together
// exceed 3.6 standard deviations (0.01 / 30, two-sided), 3.9 %, in one of 100 seeds. A percentile
// interval of a deviation falls short of its level by some (kurtosis - 1) / n terms: 1 % more is
// allowed. Intervals of medians hold their level or more.
// Of 400 poses every one is a group of its own, 2600 are drawn in groups.
TEST(PoseIntervals, CoverTheTruthInNineteenOfTwentyStudies) {
    constexpr int repetitions = 400;
    for (const int poses : {400, 2600})
        for (const auto& counts : covering(poses, repetitions))
            for (const int count : counts)
                EXPECT_NEAR(1.0 * count / repetitions, 0.95, 0.039 + 0.01) << poses;
}

}  // namespace
}  // namespace etalon
