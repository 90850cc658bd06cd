// A marker's outline in the image.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "calib/camera/projector.h"
#include "sim/scene/marker_view.h"

namespace etalon {

// Pixels along the outline, side after side (upper, right, lower, left) with the same number of
// points on each, its ends included; nothing when some of it has no image.
std::vector<Eigen::Vector2d> marker_outline(const MarkerView& view, const Projector& projector,
                                            int points_per_side);

// The pixels within `margin` (px, along x and y) of the outline's bounding box, as far as they are
// in `limit`; all of `limit` for an empty outline. Distortion may bulge a side out between two
// points: the margin must hold that too.
cv::Rect pixels_around(const std::vector<Eigen::Vector2d>& outline, const Eigen::Array2d& margin,
                       const cv::Rect& limit);

}  // namespace etalon
