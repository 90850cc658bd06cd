// Where a calibration starts: focal lengths and poses from the homographies of the views.
//
// Zhang, "A flexible new technique for camera calibration" (PAMI 2000), has the focal lengths in
// closed form, which distortion upsets, and which fails (a negative square) where the perspective
// is below the noise, as before a telephoto lens. Here the pixels are first undistorted by the
// division model's one parameter (Fitzgibbon, CVPR 2001) that makes the views most nearly
// homographies, which needs no focal length. Then the focal lengths are searched, from a hundredth
// of the image's diagonal to ten thousand of them and with pixels' ratios from 1/2 to 2, by how
// well the poses project that a homography's first derivatives give (Collins and Bartoli,
// "Infinitesimal Plane-Based Pose Estimation", IJCV 2014).
//
// Needs checked views. Some ms for eight views of 54 points.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <vector>

#include "calib/intrinsics/calibration_view.h"
#include "calib/intrinsics/camera_fit.h"
#include "core/geometry/rigid.h"

namespace etalon {

// The principal point is in the middle of the image, distortion zero. Throws NumericalError when no
// focal length puts every view in front of the camera.
CameraStart calibration_start(std::span<const CalibrationView> views, cv::Size image_size);

// Starts for a wide lens, whose views are no homographies: for each of a few guesses of the
// projection's parameters the focal length, of a grid over what lenses have, with which the poses
// of the views fit best. Throws NumericalError when no such camera sees every view.
std::vector<CameraStart> wide_calibration_starts(std::span<const CalibrationView> views,
                                                 cv::Size image_size, Projection projection);

// The pose of points (x, y, 0) seen at undistorted normalised coordinates (X/Z, Y/Z), from their
// homography. Nothing when the points would be behind the camera.
std::optional<Rigid> pose_from_homography(const std::vector<Eigen::Vector3d>& points_mm,
                                          const std::vector<Eigen::Vector2d>& normalised);

// The same of points seen at undistorted points of a projection's plane, from the homography onto
// the plane across their mean ray; those more than 80 degrees from it do not count. Nothing for
// fewer than four that count.
std::optional<Rigid> pose_from_plane(const std::vector<Eigen::Vector3d>& points_mm,
                                     const std::vector<Eigen::Vector2d>& undistorted,
                                     const LensProjection& projection);

// How far the pixels are from any homography of the view's plane: root mean square of the algebraic
// distances, relative to the view's extent. Noise makes some thousandths of it, a strong distortion
// some hundredths, points in a wrong order tenths.
double plane_misfit(const CalibrationView& view);

// The other pose in which a small plane around `centre_mm` looks nearly the same: its normal
// mirrored at the line of sight.
Rigid mirrored_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm);

}  // namespace etalon
