// The plots of edge shifts: arrows along the edges of one photograph, their field over the image
// for all photographs, shift and blur by image radius and by depth.
#pragma once

#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <vector>

#include "station/compare/comparison_report.h"

namespace etalon {

// How many times larger than measured shifts are drawn, for all photographs the same: 1, 2 or 5
// times a power of ten that makes their RMS about 12 px.
double arrow_magnification(const Comparison& comparison);

// Edges as thin lines and their shifts as arrows, from the rendering's edge to the photograph's:
// those over three standard deviations in colour. `part` is the part of the image that is shown.
std::string edge_map_svg(std::span<const EdgeShift> edges, const cv::Rect& part,
                         double magnification);

// Of all photographs together; none where no edges were measured.
std::vector<ComparisonPlot> edge_plots(const Comparison& comparison);

}  // namespace etalon
