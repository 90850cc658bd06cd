// Where a photograph differs from its rendering by a good part of the contrast over more than an
// edge's width: something covers the marker, or shines on it.
//
// The residual is averaged over square windows of a third of a cell, but at least 3 px, beside the
// edges: a displaced or blurred edge is another fault. Cells of 4 px and less have no such places.
#pragma once

#include <opencv2/core.hpp>

#include "compare/photometric/photometric_model.h"
#include "compare/photometric/pixel_difference.h"

namespace etalon {

struct CoveredAreas {
    double largest = 0.0;       // of all windows, in parts of the contrast
    double share = 0.0;         // of the compared pixels that lie in windows above the limit
    double bright_share = 0.0;  // of those that are brighter than the marker's white or clipped
    cv::Mat pixels;             // CV_8UC1, 255: in such a window, or within a pixel of it
};

// `limit` in parts of the contrast (white minus black of the photometric model at the place). The
// windows' side is in px. Safe from every thread. Throws NumericalError when sizes differ.
CoveredAreas covered_areas(const cv::Mat& photo_gray, const PixelDifference& difference,
                           double window_px, double limit, double saturation_gray);

}  // namespace etalon
