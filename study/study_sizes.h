// Detection and corner error by the marker's size in the image, for users who know how large their
// markers will be.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "compare/expect/pose_statistics.h"

namespace etalon {

// The poses at which the marker has from_px <= size < to_px. The size is that of results.csv: the
// root of the area that the marker's points span in the image.
struct SizeClass {
    double from_px = 0.0;
    std::optional<double> to_px;  // nothing: no upper end
    std::size_t poses = 0;
    std::optional<Proportion> detected;  // nothing without poses
    // Of the RMS corner errors of the detected poses. Nothing where no pose has corners; the
    // quantile (the smallest error that 95 % of them do not exceed) not of too few.
    std::optional<Estimate> median_corner_px;
    std::optional<double> corner_quantile_px;
};

// The quantile needs this many values: below, it is the largest of them.
inline constexpr std::size_t min_quantile_values = 20;

// Below 25 px, 25 to 40, 40 to 60, 60 to 100, from 100; then, over some of these, from 60 and all.
// An entry per pose in each argument (NumericalError otherwise). 0.2 us a pose.
std::vector<SizeClass> size_classes(const DetectorErrors& errors, std::span<const double> sizes_px,
                                    std::span<const std::optional<double>> corner_rms_px);

// "below 25", "25 to 40", "from 60", "all"
std::string size_words(const SizeClass& one);

}  // namespace etalon
