// Does a quantity go up or down from run to run? The test of Mann and Kendall (Mann, Econometrica
// 13 (1945) 245-259), which needs no distribution, no baseline and no uncertainty of the values: S
// is the number of pairs of runs whose later one is larger, less that of those whose later one is
// smaller. In independent values of one distribution every order is as likely, so the chance of an
// |S| as large is known exactly; ties make it smaller than said.
//
// It finds what the control chart (control_chart.h) is slow to: a drift in equal steps from the
// first run on. It does not find what went up and came down again.
#pragma once

#include <optional>
#include <span>

namespace etalon {

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

// In the order of the runs; of more than 400 the last 400. Exact up to 60, beyond by the normal
// approximation with continuity correction (Kendall). Throws NumericalError for values that are not
// finite.
Trend trend_of(std::span<const TimedValue> values);

// With so many quantities tested together each may give a false alarm at this probability
// (Bonferroni).
double trend_limit(int quantities);

// So few runs that no order of them could be below the limit.
bool is_too_short_for_trend(int runs, int quantities);

}  // namespace etalon
