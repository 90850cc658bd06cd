// 95 % intervals of a calibration's parameters where a standard deviation does not say enough: with
// a parameter held at an end of its interval and all else fitted again, the sum of squares is what
// Student's distribution allows more than the least one (profile t: Bates and Watts, "Nonlinear
// Regression Analysis and Its Applications", 1988, 6.1).
//
// Focal length, xi and the distortion of an omnidirectional lens trade for each other over a range
// in which none of them acts linearly. The deviation at the solution is then that of a neighbour as
// much as of the truth, and twice it to both sides holds the truth in 90 % of calibrations where
// the profile's interval does in 95 %. What a lens projects is not concerned: that is nearly
// linear (docs/calibration.md has the figures).
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <vector>

#include "calib/intrinsics/calibration_view.h"
#include "calib/intrinsics/camera_fit.h"

namespace etalon {

struct ProfileInterval {
    double low = 0.0, high = 0.0;
};

// An interval lies askew whose ends are this share of its length nearer and farther than each
// other.
inline constexpr double askew_share = 0.1;

// Student's: an interval reaches so many deviations to both sides where a parameter acts linearly.
double profile_quantile(std::span<const CalibrationView> views, const CalibrationModel& model);

// In the order of the model's parameters, for a fit of these views and model. `deviations` are
// those to be stated; where photos share errors they are larger than the fit's formal ones, and as
// much more may the sum of squares rise. Nothing for a parameter without such ends in reach, and
// for all of a fit with a pull (rational and richer) or without residuals. Two or three fits an
// end, on all cores, with the same result for any number of them.
std::vector<std::optional<ProfileInterval>> profile_intervals(
    std::span<const CalibrationView> views, cv::Size image_size, const CalibrationModel& model,
    const CameraFit& fit, const Eigen::VectorXd& deviations);

}  // namespace etalon
