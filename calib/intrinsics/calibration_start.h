// Where a calibration starts: focal lengths and poses from the homographies of the views.
//
// Zhang's closed form (PAMI 2000) fails with distortion or little perspective. Here the pixels are
// first undistorted by the division model (Fitzgibbon, CVPR 2001) that makes the views most nearly
// homographies. Then focal lengths, 0.01 to 10 000 image diagonals with pixels' ratios from 1/2 to
// 2, are searched by how well the homographies' poses project (Collins and Bartoli, "Infinitesimal
// Plane-Based Pose Estimation", IJCV 2014). Needs checked views. Some ms for eight views of 54
// points.
#pragma once

#include "calib/intrinsics/camera_fit.h"

namespace etalon {

// The principal point is in the middle of the image, distortion zero. Throws NumericalError when no
// focal length puts every view in front of the camera.
CameraStart calibration_start(std::span<const CalibrationView> views, cv::Size image_size);

// Starts for a wide lens: for a few guesses of the projection's parameters the focal length, of a
// grid, with which the views' poses fit best. Throws NumericalError when no camera sees every view.
std::vector<CameraStart> wide_calibration_starts(std::span<const CalibrationView> views,
                                                 cv::Size image_size, Projection projection);

// The pose of points (x, y, 0) seen at undistorted normalised coordinates (X/Z, Y/Z), from their
// homography. Nothing when the points would be behind the camera.
std::optional<Rigid> pose_from_homography(const std::vector<Eigen::Vector3d>& points_mm,
                                          const std::vector<Eigen::Vector2d>& normalised);

// The same of points of a projection's plane, from the homography across their mean ray; points
// more than 80 degrees from it do not count. Nothing for fewer than four that do.
std::optional<Rigid> pose_from_plane(const std::vector<Eigen::Vector3d>& points_mm,
                                     const std::vector<Eigen::Vector2d>& undistorted,
                                     const LensProjection& projection);

// Root mean square distance (algebraic) of the pixels from any homography of the plane, relative to
// the view's extent. Noise: some thousandths, strong distortion: hundredths, wrong order: tenths.
double plane_misfit(const CalibrationView& view);

// The other pose in which a small plane around `centre_mm` looks nearly the same: its normal
// mirrored at the line of sight.
Rigid mirrored_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm);

// By which models the lens of these views may be followed: perspective ones, a wide lens's, or
// both.

enum class LensAngle {
    ordinary,  // perspective models, and no point is 40 degrees or more from the axis, so that
               // those of wide lenses say nothing else
    either,    // perspective models, but there are points so far out: photos left out tell
    wide,      // perspective models leave more than noise, a wide lens's leaves less than half of
               // that, and by that one there are points more than 50 degrees from the axis
};

// Views must have passed check_view(). Two fits for a lens that is not wide, some ten ms; a few
// more for one that is.
LensAngle lens_angle(std::span<const CalibrationView> views, cv::Size image_size);

// The start of a telecentric calibration, from the affine maps of the views: K A + t, K = diag(fx,
// fy), A the upper left 2 x 2 of a rotation with singular values 1 and the cosine of the tilt
// (Tomasi and Kanade, IJCV 9, 1992). fy / fx, from 1/2 to 2, makes the larger singular values of
// all views most alike. Distance and sign of the tilt have no effect: points lie twice as far away
// as the farthest of them from their middle. Needs checked views. Microseconds.

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
