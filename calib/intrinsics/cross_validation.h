// Two calibrations of one camera that share no photo, and how differently they project: the test
// that a stated uncertainty has to stand. Each half is every second view, so that a drift over the
// session is in both.
//
// The difference is taken over the part of the image that the points reach (their convex hull),
// after the rotation of the camera that takes back most of it, places weighing as much as they are
// certain (calib/intrinsics/projection_uncertainty.h). What it should be follows from the
// covariances of the halves; when it is much larger, they are too small.
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "calib/intrinsics/calibration_view.h"
#include "calib/intrinsics/camera_fit.h"
#include "calib/intrinsics/projection_uncertainty.h"

namespace etalon {

inline constexpr std::size_t min_cross_validation_views = 6;

struct CrossValidation {
    std::array<std::size_t, 2> views{};  // in each half
    // Second minus first camera.
    std::vector<Eigen::Vector2d> pixels, differences_px;
    double rms_px = 0.0, worst_px = 0.0;  // of the distance
    // The RMS that the halves' covariances lead to expect, formal and cluster-robust.
    double expected_formal_px = 0.0, expected_robust_px = 0.0;
};

// `fit` is that of all views and the start of both searches. Throws NumericalError for less than
// six views, and when a half does not determine the camera. Some milliseconds.
CrossValidation cross_validate(std::span<const CalibrationView> views, cv::Size image_size,
                               const CalibrationModel& model, const CameraFit& fit);

// Second minus first: where the second camera sees the first one's rays, after the second was
// turned by the rotation (telecentric: about the axis, and shifted) that takes back most of the
// difference. `deviations` (px) say how much
// each ray weighs. Rays that the second one does not see are left out.
struct ProjectionDifference {
    std::vector<Eigen::Vector2d> pixels, differences_px;
};
ProjectionDifference projection_difference(const CameraModel& second,
                                           const ImageRays& rays_of_first,
                                           const Eigen::VectorXd& deviations);

}  // namespace etalon
