#include <numeric>

#include "core/statistics/random.h"
#include "station/history/control_chart.h"
#include "tests/test.h"

namespace etalon {
namespace {

// By hand: before the third value mean 2 and s = sqrt(2), so t = 3 / (sqrt(2) sqrt(3/2)) = sqrt(3),
// and of one degree of freedom F(sqrt(3)) = 1/2 + atan(sqrt(3)) / pi = 5/6.
TEST(ControlChart, HasTheQOfThreeValuesByHand) {
    const std::vector<double> values = {1.0, 3.0, 5.0};
    const auto points = drift_chart(values);
    EXPECT_FALSE(points[0].q || points[1].q);
    const double phi = 0.5 * std::erfc(-*points[2].q / std::numbers::sqrt2);
    EXPECT_NEAR(phi, 5.0 / 6.0, 1e-14);
    EXPECT_NEAR(*points[2].ewma, 0.25 * *points[2].q, 1e-15);
    const auto mirrored = drift_chart(std::vector<double>{-1.0, -3.0, -5.0});
    EXPECT_DOUBLE_EQ(*mirrored[2].q, -*points[2].q);
}

TEST(ControlChart, SaysNothingWhileAllValuesAreEqual) {
    const auto points = drift_chart(std::vector<double>{7, 7, 7, 7, 8, 7});
    for (int i = 0; i < 5; ++i)
        EXPECT_FALSE(points[static_cast<std::size_t>(i)].q);
    EXPECT_TRUE(points[5].q);
    EXPECT_THROW(drift_chart(std::vector<double>{7, NAN}), NumericalError);
}

TEST(ControlChart, RaisesTheAlarmSoonAfterAShiftAndKeepsItsSign) {
    RandomStream random(5, 0);
    std::vector<double> values;
    for (int i = 0; i < 30; ++i)
        values.push_back(0.07 + 0.005 * random.normal() - (i >= 20 ? 3 * 0.005 : 0.0));
    const auto points = drift_chart(values);
    int first = 0;
    while (first < 29 && !points[static_cast<std::size_t>(first)].alarm)
        ++first;
    // A shift of 3 deviations moves z by 0.25 * 3 a run: past 1.096 in two or three.
    EXPECT_GE(first, 20);
    EXPECT_LE(first, 24);
    EXPECT_LT(*points[static_cast<std::size_t>(first)].ewma, 0.0);
}

// The chart of normal values with known mean and deviation as a Markov chain of m states between
// the limits (Brook and Evans, Biometrika 59 (1972) 539-549): an independent way to its alarms.
class KnownChart {
public:
    explicit KnownChart(int states) : m_(states), from_(states, std::vector<double>(states)) {
        const double width = 2.0 * drift_limit / m_;
        const auto phi = [](double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); };
        for (int i = 0; i < m_; ++i)
            for (int k = 0; k < m_; ++k) {
                const double at = centre(i), low = -drift_limit + k * width;
                const auto q = [&](double z) {
                    return (z - (1.0 - drift_weight) * at) / drift_weight;
                };
                from_[i][k] = phi(q(low + width)) - phi(q(low));
            }
    }
    // Proportion of charts without an alarm after each of `runs` values, from z = 0.
    std::vector<double> silent(int runs) const {
        std::vector<double> state(m_), shares;
        state[m_ / 2] = 1.0;
        for (int run = 0; run < runs; ++run) {
            std::vector<double> next(m_);
            double sum = 0.0;
            for (int i = 0; i < m_; ++i)
                for (int k = 0; k < m_; ++k)
                    next[k] += state[i] * from_[i][k];
            for (const double share : next)
                sum += share;
            shares.push_back(sum);
            state = next;
        }
        return shares;
    }

private:
    double centre(int i) const { return -drift_limit + (i + 0.5) * 2.0 * drift_limit / m_; }
    int m_;
    std::vector<std::vector<double>> from_;
};

// Mean run length: the sum of the shares that are still silent. The tail beyond 4000 values is
// 373 exp(-4000 / 373) = 0.01.
TEST(ControlChart, HasOneFalseAlarmIn373RunsWhenMeanAndDeviationAreKnown) {
    double mean = 1.0;
    for (const double share : KnownChart(101).silent(4000))
        mean += share;
    EXPECT_NEAR(mean, runs_per_false_alarm, 1.0);
}

// The point of the chart: neither mean nor deviation are known, and still it has exactly these
// false alarms. 4000 charts of 40 values, 38 of which are judged; the share with an alarm is p =
// 9 % by the chain, its standard deviation sqrt(p (1 - p) / 4000) = 0.45 %; 3.5 of them.
TEST(ControlChart, HasTheSameFalseAlarmsWithoutKnowingMeanAndDeviation) {
    constexpr int charts = 4000, runs = 40;
    int alarms = 0;
    double sum = 0.0, squares = 0.0, products = 0.0;
    for (int c = 0; c < charts; ++c) {
        RandomStream random(9, static_cast<std::uint32_t>(c));
        std::vector<double> values;
        for (int i = 0; i < runs; ++i)
            values.push_back(-7.0 + 5.0 * random.normal());
        const auto points = drift_chart(values);
        bool any = false;
        for (const ChartPoint& point : points)
            any = any || point.alarm;
        alarms += any;
        sum += *points[4].q;
        squares += *points[4].q * *points[4].q;
        products += *points[4].q * *points[5].q;
    }
    const double expected = 1.0 - KnownChart(101).silent(runs - 2).back();
    const double deviation = std::sqrt(expected * (1.0 - expected) / charts);
    EXPECT_NEAR(static_cast<double>(alarms) / charts, expected, 3.5 * deviation);
    // Standard normal and independent of each other, after no more than four values.
    EXPECT_NEAR(sum / charts, 0.0, 3.5 / std::sqrt(charts));
    EXPECT_NEAR(squares / charts, 1.0, 3.5 * std::sqrt(2.0 / charts));
    EXPECT_NEAR(products / charts, 0.0, 3.5 / std::sqrt(charts));
}

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
