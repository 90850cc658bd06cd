// Tails and quantiles of the distributions that intervals, limits and uncertainties rest on. Pure
// functions; degrees of freedom of chi-square need not be whole.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

namespace etalon {

// P(Z <= z) of the standard normal distribution.
inline double normal_probability(double z) {
    return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

// The z with P(Z > z) = upper_tail of the standard normal distribution, 0 < upper_tail < 1.
double normal_quantile(double upper_tail);

// P(T <= t) of Student's t with `degrees_of_freedom` >= 1.
double student_t_probability(double t, int degrees_of_freedom);

// The t with P(T <= t) = 1 - upper_tail, 0 < upper_tail <= 0.5, for intervals from few values (GUM,
// annex G.3). Throws NumericalError for other arguments.
double student_t_quantile(double upper_tail, int degrees_of_freedom);

// P(F > f) of Fisher's F, both degrees of freedom > 0; 1 where f is not positive.
double fisher_tail(double f, double freedom_above, double freedom_below);

// The quantile of chi-square over its degrees of freedom (> 0) that lies as far out as `z` does in
// the standard normal distribution: 0 for the median, 1.645 for 95 %.
double reduced_chi_square(double z, double degrees_of_freedom);

// The largest k with P(K <= k) <= lower_tail, of K heads in `tosses` tosses of a fair coin; 0 also
// where no k has so small a tail.
std::size_t coin_quantile(double lower_tail, std::size_t tosses);

// A share of independent trials with Wilson's score interval (Journal of the American Statistical
// Association 22, 1927), which stays in [0, 1] and does not shrink to nothing at 0 and 1.
struct Proportion {
    std::size_t count = 0, trials = 0;
    double value = 0.0;            // count / trials
    double low = 0.0, high = 1.0;  // two-sided, 95 %
};

// 0 <= count <= trials, trials > 0; throws NumericalError otherwise.
Proportion wilson_share(std::size_t count, std::size_t trials);

// The median; of an even number the mean of the two in the middle. `values` not empty, without NaN.
inline double median(std::vector<double> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    if (values.size() % 2 == 1)
        return *middle;
    return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

// 1.4826 times the median distance from the median: of normal values their standard deviation.
inline double median_deviation(std::vector<double> values) {
    const double middle = median(values);
    for (double& value : values)
        value = std::abs(value - middle);
    return 1.4826 * median(std::move(values));
}

}  // namespace etalon
