#include "station/history/control_chart.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

std::vector<TimedValue> days(const std::vector<double>& values, double step_days = 1.0) {
    std::vector<TimedValue> timed;
    for (const double value : values)
        timed.push_back({static_cast<double>(timed.size()) * step_days, value});
    return timed;
}

long s_of(const std::vector<double>& values) {
    long s = 0;
    for (std::size_t j = 0; j < values.size(); ++j)
        for (std::size_t i = 0; i < j; ++i)
            s += (values[j] > values[i]) - (values[j] < values[i]);
    return s;
}

// Every order of n values is counted.
TEST(TrendOfRuns, HasTheProbabilityThatCountingAllOrdersGives) {
    for (int n = 2; n <= 7; ++n) {
        std::vector<double> order(static_cast<std::size_t>(n));
        std::iota(order.begin(), order.end(), 1.0);
        std::vector<long> all;
        do
            all.push_back(std::abs(s_of(order)));
        while (std::ranges::next_permutation(order).found);
        const std::vector<double> some = {3, 1, 4, 1.5, 9, 2, 6};
        const std::vector<double> values(some.begin(), some.begin() + n);
        const auto as_large =
            std::ranges::count_if(all, [&](long s) { return s >= std::abs(s_of(values)); });
        EXPECT_NEAR(trend_of(days(values)).probability,
                    static_cast<double>(as_large) / static_cast<double>(all.size()), 1e-12);
    }
}

// Kendall's table for n = 10: P(S >= 29) = 0.0046, so two-sided 0.0092.
TEST(TrendOfRuns, AgreesWithKendallsTable) {
    const std::vector<double> values = {4, 3, 2, 1, 6, 5, 7, 8, 10, 9};  // 8 inversions
    ASSERT_EQ(s_of(values), 29);
    EXPECT_NEAR(trend_of(days(values)).probability, 2 * 0.0046, 1e-4);
}

TEST(TrendOfRuns, IsContinuousWhereItBecomesApproximate) {
    std::vector<double> values;
    for (int i = 0; i < 60; ++i)
        values.push_back(std::sin(40.0 * i) + 0.015 * i);
    const double exact = trend_of(days(values)).probability;
    values.push_back(std::sin(40.0 * 60) + 0.015 * 60);
    EXPECT_NEAR(trend_of(days(values)).probability / exact, 1.0, 0.5);
    EXPECT_LT(exact, 0.2);
}

// Half a unit every 73 days is 2.5 units a year; one wild value moves the median slope little.
TEST(TrendOfRuns, GivesTheRateInAYear) {
    std::vector<double> values;
    for (int i = 0; i < 9; ++i)
        values.push_back(7.0 + 0.5 * i);
    EXPECT_NEAR(trend_of(days(values, 73.05)).per_year.value(), 2.5, 1e-12);
    values[4] = 100.0;
    EXPECT_NEAR(trend_of(days(values, 73.05)).per_year.value(), 2.5, 0.1);
    EXPECT_FALSE(trend_of(days(values, 0.0)).per_year);
    EXPECT_EQ(trend_of({}).runs, 0);
    EXPECT_THROW(trend_of(days({1.0, NAN})), NumericalError);
}

TEST(TrendOfRuns, KnowsWhenNoOrderCouldShowOne) {
    EXPECT_TRUE(is_too_short_for_trend(5, 1));   // 2 / 5! = 1.7 %
    EXPECT_FALSE(is_too_short_for_trend(6, 1));  // 2 / 6! = 0.3 %
    EXPECT_TRUE(is_too_short_for_trend(6, 5));   // 1 % / 5 = 0.2 %
    EXPECT_FALSE(is_too_short_for_trend(7, 5));
}

// How many of so many cameras show a trend in one of their quantities. The quantities go together,
// as those of one run do; each drifts by `drift` of its standard deviations from run to run.
int cameras_with_trend(int cameras, int quantities, int runs, double drift) {
    int found = 0;
    for (int camera = 0; camera < cameras; ++camera) {
        RandomStream random(7, 11, static_cast<std::uint64_t>(camera));
        std::vector<std::vector<double>> values(static_cast<std::size_t>(quantities));
        for (int run = 0; run < runs; ++run) {
            const double shared = random.normal();
            for (std::vector<double>& one : values)
                one.push_back(std::sqrt(0.5) * (shared + random.normal()) + drift * run);
        }
        found += std::ranges::any_of(values, [&](const std::vector<double>& one) {
            return trend_of(days(one)).probability <= trend_limit(quantities);
        });
    }
    return found;
}

// At most 1 % by the bound of Bonferroni; 3.5 standard errors of 4000 draws are 0.55 %.
TEST(TrendOfRuns, AlarmsFalselyForOneCameraInAHundredAtMost) {
    constexpr int cameras = 4000;
    for (const auto& [quantities, runs] : {std::pair(1, 8), std::pair(4, 10), std::pair(8, 25)}) {
        const double share =
            static_cast<double>(cameras_with_trend(cameras, quantities, runs, 0.0)) / cameras;
        RecordProperty("false_alarms_percent", std::to_string(100.0 * share));
        EXPECT_LE(share, trend_false_alarm + 0.0055) << quantities << " quantities, " << runs;
        EXPECT_GE(share, 0.001) << "the test says nothing";
    }
}

// What the control chart partly takes for spread: equal steps from the first run on.
TEST(TrendOfRuns, FindsASteadyDrift) {
    constexpr int cameras = 400;
    EXPECT_GE(cameras_with_trend(cameras, 2, 12, 0.5), 0.90 * cameras);
    EXPECT_GE(cameras_with_trend(cameras, 2, 25, 0.15), 0.90 * cameras);
    EXPECT_LE(cameras_with_trend(cameras, 2, 12, 0.05), 0.20 * cameras);  // this one it does not
}

}  // namespace
}  // namespace etalon
