// Whether views determine the camera that was fitted to them well enough to be used at all.
#pragma once

#include <span>

#include "calib/intrinsics/calibration_view.h"
#include "calib/intrinsics/camera_fit.h"

namespace etalon {

// Throws NumericalError, naming what is weak, for a rank lost, and for a focal length that noise
// (0.1 px, or what the fit leaves if that is more) makes uncertain by more than a tenth. Of a
// telecentric lens also unless views that are tilted by more than hardly_tilted_rad, about several
// axes, tell fx and fy to a hundredth, and for a distortion too weak to tell its centre to half the
// image. `equations` are the fit's.
void check_determinacy(std::span<const CalibrationView> views, const CameraFit& fit,
                       const CalibrationModel& model, std::span<const ViewEquations> equations);

}  // namespace etalon
