// The 36 pairs of a marker study: each of a detector's six pose errors against each of the six
// degrees of freedom of the true pose, as densities.
//
// An error's axis spans the median +- 6 robust standard deviations (1.4826 times the median
// distance from the median), or less where the data end before. What lies beyond is drawn in a
// panel's rims and counted at the row. Lines are mean and +- standard deviation inside the axis, by
// bins.
#pragma once

#include "compare/expect/pose_statistics.h"
#include "report/html.h"
#include "sim/scene/pose_volume.h"

namespace etalon {

// The errors of the poses in a slice of the degree of freedom.
struct PairBin {
    RunningMoments inside, all;  // within the error's axis; with those beyond it
};

struct PairPanel {
    // Poses per cell, row by row: the first row is what lies above the axis, then its cells from
    // high to low errors, then what lies below. Columns from low to high.
    std::vector<std::uint32_t> counts;
    std::vector<PairBin> bins;
};

struct PairMatrix {
    static constexpr std::size_t columns = 72, rows = 48, bins = 18;  // of a panel
    static constexpr double robust_deviations = 6.0;  // that an error's axis spans, both ways

    std::string detector;
    std::size_t poses = 0, detected = 0;
    std::array<Interval, pose_component_count> freedoms, errors;
    std::array<std::size_t, pose_component_count> above{}, below{};  // beyond an error's axis
    // By error, then by degree of freedom; empty when nothing was detected.
    std::array<std::array<PairPanel, pose_component_count>, pose_component_count> panels;

    std::uint32_t highest_count() const;  // of a cell, in any panel
};

// `truth` and `errors` have an entry per pose (NumericalError otherwise). 1 us a pose.
PairMatrix pair_matrix(const std::string& detector, std::span<const PoseComponents> truth,
                       const DetectorErrors& errors);

// A file of its own, for papers. Some 0.3 MB at any number of poses.
std::string pair_matrix_svg(const PairMatrix& matrix);

// All matrices, one at a time behind tabs; printed, all. 0.5 MB a detector. Once per page.
void add_pair_matrices(HtmlPage& page, std::span<const PairMatrix> matrices);

}  // namespace etalon
