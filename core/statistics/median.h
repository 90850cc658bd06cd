// The median, for whatever must not be moved by a few wild values.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace etalon {

// Of an even number the mean of the two in the middle. `values` must not be empty nor hold NaN.
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
