// Where a calibration starts: focal lengths and poses from the homographies of the views.
//
// Zhang, "A flexible new technique for camera calibration" (PAMI 2000), has the focal lengths in
// closed form, which fails for what a telephoto lens sees of perspective below its noise (a
// negative square). Here the focal lengths are searched: from a hundredth of the image's diagonal
// to ten thousand of them, for the pixels' ratios 1/2 to 2, the pair whose poses project best.
//
// Homography: Hartley and Zisserman, "Multiple View Geometry" (2004), 4.4.4. Needs checked views.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <vector>

#include "calib/calibration_view.h"
#include "calib/camera_fit.h"
#include "core/rigid.h"

namespace etalon {

// The principal point is in the middle of the image, distortion zero. Throws NumericalError when no
// focal length puts every view in front of the camera.
CameraStart calibration_start(std::span<const CalibrationView> views, cv::Size image_size);

// The pose of points (x, y, 0) seen at undistorted normalised coordinates (X/Z, Y/Z) by a
// homography made a rotation. Nothing when the points would be behind the camera.
std::optional<Rigid> pose_from_homography(const std::vector<Eigen::Vector3d>& points_mm,
                                          const std::vector<Eigen::Vector2d>& normalised);

// The other pose in which a small plane around `centre_mm` looks nearly the same: its normal
// mirrored at the line of sight.
Rigid mirrored_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm);

}  // namespace etalon
