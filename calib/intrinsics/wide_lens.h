// Whether these views are of a lens that only a wide lens's model follows.
#pragma once

#include <opencv2/core.hpp>
#include <span>

#include "calib/intrinsics/calibration_view.h"

namespace etalon {

// Perspective models leave more than noise of them, a wide lens's model leaves less than half of
// that, and by that one there are points more than 50 degrees from the axis. Views must have passed
// check_view(). Two fits for a lens that is not wide, some ten ms; a few more for one that is.
bool is_wide_lens(std::span<const CalibrationView> views, cv::Size image_size);

}  // namespace etalon
