// Where a calibration starts: focal lengths and poses from the homographies of the views.
//
// Zhang's closed form (PAMI 2000) is upset by distortion and fails where the perspective is below
// the noise. Here the pixels are first undistorted by the division model's one parameter
// (Fitzgibbon, CVPR 2001) that makes the views most nearly homographies. Then focal lengths from a
// hundredth of the image's diagonal to ten thousand of them, with pixels' ratios from 1/2 to 2, are
// searched by how well the poses project that a homography's first derivatives give (Collins and
// Bartoli, "Infinitesimal Plane-Based Pose Estimation", IJCV 2014).
//
// Needs checked views. Some ms for eight views of 54 points.
#pragma once

#include "calib/intrinsics/camera_fit.h"

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

// Where the calibration of a telecentric camera starts: magnification and poses from the affine
// maps of the views.
//
// A plane is seen by the map K A + t, K = diag(fx, fy) and A the upper left 2 x 2 of a rotation,
// with singular values 1 and the cosine of the tilt (Tomasi and Kanade, IJCV 9, 1992). fy / fx,
// from 1/2 to 2, is the one with which the larger singular values of all views are most alike. The
// distance and the sign of the tilt have no effect: points lie twice as far away as the farthest of
// them from their middle.
//
// Needs checked views. Microseconds.

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
