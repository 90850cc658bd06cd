// A control chart for a handful of runs of unknown mean and spread: has a quantity drifted?
//
// Every value is compared with those before it (a Q chart: Quesenberry, SPC Q charts for start-up
// processes and short or long runs, J. Quality Technology 23 (1991) 213-224):
//
//     t_i = (x_i - mean of x_1..x_(i-1)) / (s_(i-1) sqrt(i / (i - 1))),   Q_i =
//     Phi^-1(F_(i-2)(t_i))
//
// F is Student's distribution of i - 2 degrees of freedom. While the values are independent and
// normal, Q_3, Q_4, ... are independent and standard normal: the false-alarm rate is known from the
// third run on. Their exponentially weighted moving average is judged:
//
//     z_i = 0.25 Q_i + 0.75 z_(i-1),   alarm where |z_i| > 2.90 sqrt(0.25 / 1.75) = 1.096
//
// which is one false alarm in 373 runs on average (Crowder, J. Quality Technology 21 (1989)
// 155-162; tests/station/history/control_chart_test.cpp counts them). A drift in equal steps from
// the first run on is partly taken for spread. Runs count, not days.
#pragma once

#include <optional>
#include <span>
#include <vector>

namespace etalon {

// Does a quantity go up or down from run to run? The test of Mann and Kendall (Mann, Econometrica
// 13 (1945) 245-259) needs no distribution and no uncertainty of the values. S is the number of
// pairs of runs whose later one is larger, less those whose later one is smaller. In independent
// values of one distribution the chance of an |S| as large is known exactly; ties make it smaller
// than said. It finds a drift in equal steps from the first run on, but not what went up and came
// down again.

// That a camera without any trend shows one in one of its quantities when it is looked at.
inline constexpr double trend_false_alarm = 0.01;

struct TimedValue {
    double day = 0.0, value = 0.0;
};

struct Trend {
    int runs = 0;
    double probability = 1.0;        // of an |S| at least as large without a trend, two-sided
    std::optional<double> per_year;  // median slope of all pairs (Sen, J. Am. Stat. Assoc. 63
                                     // (1968) 1379-1389); nothing where all are of one moment
};

// In the order of the runs; at most the last 400. Exact up to 60, beyond by Kendall's normal
// approximation with continuity correction. Throws NumericalError for values not finite.
Trend trend_of(std::span<const TimedValue> values);

// Probability of a false alarm of each of so many quantities tested together (Bonferroni).
double trend_limit(int quantities);

// So few runs that no order of them could be below the limit.
bool is_too_short_for_trend(int runs, int quantities);

inline constexpr double drift_weight = 0.25;
inline constexpr double drift_limit = 1.0961;          // 2.90 sqrt(0.25 / (2 - 0.25))
inline constexpr double runs_per_false_alarm = 373.0;  // of one chart

struct ChartPoint {
    std::optional<double> q;     // nothing for the first two, and while all before are equal
    std::optional<double> ewma;  // nothing before the first q
    bool alarm = false;
};

// In the order of the values. Throws NumericalError for a value that is not finite.
std::vector<ChartPoint> drift_chart(std::span<const double> values);

}  // namespace etalon
