// Tails and quantiles of the distributions that intervals, limits and uncertainties rest on. Pure
// functions; degrees of freedom of chi-square need not be whole.
#pragma once

#include <cmath>
#include <cstddef>
#include <numbers>

namespace etalon {

// P(Z <= z) of the standard normal distribution.
inline double normal_probability(double z) {
    return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

// The z with P(Z > z) = upper_tail of the standard normal distribution, 0 < upper_tail < 1.
double normal_quantile(double upper_tail);

// P(T <= t) of Student's t with `degrees_of_freedom` >= 1.
double student_t_probability(double t, int degrees_of_freedom);

// The t with P(T <= t) = 1 - upper_tail, 0 < upper_tail <= 0.5, for intervals from a standard
// deviation that was itself estimated from a few values (GUM, annex G.3). Throws NumericalError for
// other arguments.
double student_t_quantile(double upper_tail, int degrees_of_freedom);

// P(F > f) of Fisher's F, both degrees of freedom > 0; 1 where f is not positive.
double fisher_tail(double f, double freedom_above, double freedom_below);

// The quantile of chi-square over its degrees of freedom (> 0) that lies as far out as `z` does in
// the standard normal distribution: 0 for the median, 1.645 for 95 %.
double reduced_chi_square(double z, double degrees_of_freedom);

// The largest k with P(K <= k) <= lower_tail, of K heads in `tosses` tosses of a fair coin; 0 also
// where no k has so small a tail.
std::size_t coin_quantile(double lower_tail, std::size_t tosses);

}  // namespace etalon
