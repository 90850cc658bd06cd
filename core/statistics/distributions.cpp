#include "core/statistics/distributions.h"

#include <fmt/format.h>
#include <boost/math/distributions/binomial.hpp>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "core/program/errors.h"

namespace etalon {
namespace {

namespace bm = boost::math;

// In double throughout: long double costs several times as much and adds no digit that is kept.
using Policy = bm::policies::policy<bm::policies::promote_double<false>>;

}  // namespace

double normal_quantile(double upper_tail) {
    return quantile(complement(bm::normal_distribution<double, Policy>(), upper_tail));
}

double student_t_probability(double t, int degrees_of_freedom) {
    return cdf(bm::students_t_distribution<double, Policy>(degrees_of_freedom), t);
}

double student_t_quantile(double upper_tail, int degrees_of_freedom) {
    if (!(upper_tail > 0.0 && upper_tail <= 0.5) || degrees_of_freedom < 1)
        throw NumericalError(
            fmt::format("no Student quantile for a tail of {} and {} degrees of "
                        "freedom",
                        upper_tail, degrees_of_freedom));
    const bm::students_t_distribution<double, Policy> student(degrees_of_freedom);
    return quantile(complement(student, upper_tail));
}

double fisher_tail(double f, double freedom_above, double freedom_below) {
    if (!(f > 0.0))
        return 1.0;
    const bm::fisher_f_distribution<double, Policy> fisher(freedom_above, freedom_below);
    return cdf(complement(fisher, f));
}

// Taken from the smaller tail, which keeps its digits far out.
double reduced_chi_square(double z, double degrees_of_freedom) {
    const bm::chi_squared_distribution<double, Policy> chi_square(degrees_of_freedom);
    const double tail = normal_probability(-std::abs(z));
    return (z > 0.0 ? quantile(complement(chi_square, tail)) : quantile(chi_square, tail)) /
           degrees_of_freedom;
}

std::size_t coin_quantile(double lower_tail, std::size_t tosses) {
    const bm::binomial_distribution<double, Policy> heads(static_cast<double>(tosses), 0.5);
    return static_cast<std::size_t>(quantile(heads, lower_tail));
}

Proportion wilson_share(std::size_t count, std::size_t trials) {
    if (trials == 0 || count > trials)
        throw NumericalError(fmt::format("share of trials: {} of {}", count, trials));
    constexpr double z = 1.959964;  // 97.5 % quantile of the normal distribution
    const auto n = static_cast<double>(trials);
    const double share = static_cast<double>(count) / n;
    const double middle = (share + z * z / (2.0 * n)) / (1.0 + z * z / n);
    const double half =
        z / (1.0 + z * z / n) * std::sqrt(share * (1.0 - share) / n + z * z / (4.0 * n * n));
    return {count, trials, share, std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

}  // namespace etalon
