// Intervals of pose statistics: the bootstrap of means and deviations, and order statistics of
// medians. The methods and their sources stand in compare/expect/pose_statistics.h, which this
// serves.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "compare/expect/pose_statistics.h"

namespace etalon {

using ErrorRow = std::array<double, error_measure_count>;

// Everything but the medians. `rows` must not be empty.
MeasureStatistics moment_statistics(std::span<const ErrorRow> rows, std::uint64_t seed);

// Reorders `values`, which must not be empty.
Estimate median_estimate(std::span<double> values);

}  // namespace etalon
