#include "station/history/control_chart.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "core/program/errors.h"
#include "core/statistics/random.h"

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

}  // namespace
}  // namespace etalon
