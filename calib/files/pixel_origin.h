// Where the calibration tools put the origin of their pixel coordinates. Here pixel (0, 0) is the
// centre of the top-left pixel (docs/conventions.md); every principal point that is read or written
// for another tool goes through these functions, and through nothing else.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

enum class CalibrationTool { opencv, ros, kalibr, mrcal, matlab, boofcv, colmap };

// What the tool calls the centre of the top-left pixel, the same along x and y: 0, 0.5 or 1 px.
double first_pixel_centre(CalibrationTool tool);

// The principal point moved from the tool's pixels to ours, and back. Within a rounding error of
// the principal point (1e-13 px of some hundreds) where the origins differ, exact otherwise.
Intrinsics from_pixels_of(CalibrationTool tool, Intrinsics intrinsics);
Intrinsics to_pixels_of(CalibrationTool tool, Intrinsics intrinsics);

}  // namespace etalon
