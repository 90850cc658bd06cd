// A share of independent trials with its confidence interval.
//
// Wilson's score interval (Journal of the American Statistical Association 22, 1927): unlike the
// one from the share's own variance it neither leaves [0, 1] nor shrinks to nothing at 0 and 1.
#pragma once

#include <cstddef>

namespace etalon {

struct Proportion {
    std::size_t count = 0, trials = 0;
    double value = 0.0;            // count / trials
    double low = 0.0, high = 1.0;  // two-sided, 95 %
};

// 0 <= count <= trials, trials > 0; throws NumericalError otherwise.
Proportion wilson_share(std::size_t count, std::size_t trials);

}  // namespace etalon
