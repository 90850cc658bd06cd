#include "core/student_t.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "core/errors.h"

namespace etalon {
namespace {

// P(|T| <= t), t >= 0.
double inside(double t, int degrees_of_freedom) {
    const double angle = std::atan(t / std::sqrt(static_cast<double>(degrees_of_freedom)));
    const double cosine = std::cos(angle), sine = std::sin(angle);
    const bool odd = degrees_of_freedom % 2 == 1;
    double term = odd ? cosine : 1.0, sum = 0.0;
    for (int power = odd ? 1 : 0; power <= degrees_of_freedom - 2; power += 2) {
        sum += term;
        term *= cosine * cosine * (power + 1.0) / (power + 2.0);
    }
    return odd ? 2.0 / std::numbers::pi * (angle + sine * sum) : sine * sum;
}

}  // namespace

double student_t_probability(double t, int degrees_of_freedom) {
    const double half = 0.5 * inside(std::abs(t), degrees_of_freedom);
    return t < 0.0 ? 0.5 - half : 0.5 + half;
}

double student_t_quantile(double upper_tail, int degrees_of_freedom) {
    if (!(upper_tail > 0.0 && upper_tail <= 0.5) || degrees_of_freedom < 1)
        throw NumericalError(
            fmt::format("no Student quantile for a tail of {} and {} degrees of "
                        "freedom",
                        upper_tail, degrees_of_freedom));
    const auto tail = [&](double t) { return 0.5 * (1.0 - inside(t, degrees_of_freedom)); };
    double low = 0.0, high = 1.0;
    while (tail(high) > upper_tail && high < 1e12)
        high *= 2.0;
    for (int halving = 0; halving < 100; ++halving) {
        const double middle = 0.5 * (low + high);
        (tail(middle) > upper_tail ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

}  // namespace etalon
