// Plots of several detectors of one study against one axis: a disturbance, a degree of freedom or
// the marker's size in the image.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "compare/expect/pose_statistics.h"
#include "report/svg_plot.h"

namespace etalon {

struct BinnedDetector {
    std::string name;
    std::vector<AxisBin> bins;  // of binned_statistics()
};

// Detection rate in percent with its 95 % interval, by bins. `axis` is a label with its unit.
SvgPlot detection_rate_plot(const std::string& axis, std::span<const BinnedDetector> detectors);

// Median |error| of one measure (its place in error_measures) with its 95 % interval, by bins;
// logarithmic where the detectors differ by more than a factor of ten.
SvgPlot median_error_plot(const std::string& axis, std::size_t measure,
                          std::span<const BinnedDetector> detectors);

}  // namespace etalon
