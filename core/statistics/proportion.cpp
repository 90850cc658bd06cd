#include "core/statistics/proportion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/program/errors.h"

namespace etalon {

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
