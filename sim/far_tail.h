// The far tail of the diffraction pattern: what a marker adds to pixels tens to thousands of pixels
// away, a few tenths of a gray. The scene is averaged over blocks of 8 x 8 px, inside the image and
// as far outside as the tail reaches.
#pragma once

#include <opencv2/core.hpp>

#include "sim/image_filter.h"
#include "sim/marker_view.h"
#include "sim/undistortion_map.h"

namespace etalon {

// Adds the far tail to `difference` (CV_32FC1, the region's size, radiance minus background), from
// everything within `reach_px`.
void add_far_tail(const MarkerView& view, const UndistortionMap& map, const ImageFilter& filter,
                  double reach_px, const cv::Rect& region, cv::Mat& difference);

}  // namespace etalon
