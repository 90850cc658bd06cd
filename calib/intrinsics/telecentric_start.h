// Where the calibration of a telecentric camera starts: magnification and poses from the affine
// maps of the views.
//
// A plane is seen by the map K A + t, K = diag(fx, fy) and A the upper left 2 x 2 of a rotation,
// whose larger singular value is 1 and whose smaller one is the cosine of the tilt (the metric
// constraints of orthography: Tomasi and Kanade, IJCV 9, 1992). So fy / fx is searched, from 1/2 to
// 2, for the one with which the larger singular values of all views are most nearly alike.
//
// The distance has no effect, and neither has the sign of the tilt: points lie twice as far away
// as the farthest of them from their middle, and which way they are tilted means nothing.
//
// Needs checked views. Microseconds.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "calib/intrinsics/calibration_view.h"
#include "calib/intrinsics/camera_fit.h"
#include "core/geometry/rigid.h"

namespace etalon {

// The principal point is in the middle of the image, distortion zero. Views that are nearly flat on
// (2 degrees) start flat on: see flat_on(). Throws NumericalError for pixels that are no plane.
CameraStart telecentric_calibration_start(std::span<const CalibrationView> views,
                                          cv::Size image_size);

// The pose of points (x, y, 0) that are seen at these undistorted points, mm.
Rigid pose_from_affine(const std::vector<Eigen::Vector3d>& points_mm,
                       const std::vector<Eigen::Vector2d>& undistorted_mm);

// The same place, but the plane z = 0 exactly across the axis. The tilt then has no effect at first
// order, and stays.
Rigid flat_on(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm);
bool is_flat_on(const Eigen::Quaterniond& camera_from_target);

// Between the plane's normal and the axis: 0 to pi/2. Up to some degrees noise may hide it.
inline constexpr double hardly_tilted_rad = 0.09;  // 5 degrees
double tilt_rad(const Eigen::Quaterniond& camera_from_target);

}  // namespace etalon
