// By which models the lens of these views may be followed: perspective ones, a wide lens's, or
// both.
#pragma once

#include <opencv2/core.hpp>
#include <span>

#include "calib/intrinsics/calibration_view.h"

namespace etalon {

enum class LensAngle {
    ordinary,  // perspective models, and no point is 40 degrees or more from the axis, so that
               // those of wide lenses say nothing else
    either,  // perspective models, but there are points so far out: photos left out tell
    wide,    // perspective models leave more than noise, a wide lens's leaves less than half of
             // that, and by that one there are points more than 50 degrees from the axis
};

// Views must have passed check_view(). Two fits for a lens that is not wide, some ten ms; a few
// more for one that is.
LensAngle lens_angle(std::span<const CalibrationView> views, cv::Size image_size);

}  // namespace etalon
