// Bundle adjustment of one camera and the poses of planar targets: the intrinsics and poses that
// bring the projected points closest to the observed pixels, in the sense of least squares.
//
// Triggs et al., "Bundle Adjustment - A Modern Synthesis" (2000); Bjorck, "Numerical Methods for
// Least Squares Problems" (1996). Levenberg-Marquardt with scaled columns. Every view's pose is
// eliminated by Householder QR, not by normal equations, so that the condition number of the
// problem counts once and not squared: k1..k6 that are correlated to 0.9999 keep their digits.
//
// A telecentric camera's poses keep the distance that they start with (docs/calibration.md). Says
// nothing about whether the model predicts well, and no standard deviations: see
// calib/intrinsics/calibrate.h. Thread-safe, deterministic, single-threaded. Eight views of 54
// points cost 1.3 ms from a start nearby and 9 ms from nothing, nine parameters free.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/camera_model.h"
#include "calib/intrinsics/calibration_model.h"
#include "calib/intrinsics/calibration_view.h"
#include "core/geometry/rigid.h"

namespace etalon {

// What richer models add, photos may hardly tell apart: k1 = k4 + 1000 fits as well as any where
// the points do not reach far, and a tilt tau_y does at first order what p2 = -s1 = tau_y / 2 do.
// Neither file nor covariance could be used then. Before a point is seen, each of k4 to k6, of the
// prism's and of the tilts is therefore taken to be normally distributed about zero, as wide as
// lenses and sensors make it with room to spare: of what it does at the outermost point, relative
// to that point's distance from the axis, these are the standard deviations. Where the points say
// something of it, that counts for far more.
inline constexpr double rational_deviation = 0.5, prism_deviation = 0.004, tilt_deviation = 0.02;

struct CameraFit {
    CameraModel camera;  // without covariance
    std::vector<Rigid> camera_from_target;
    // Observed minus projected, by view and point.
    std::vector<std::vector<Eigen::Vector2d>> residuals_px;
    // Of a pixel coordinate with sigma 1: the weighted sum of squares over the degrees of freedom,
    // 2 points - parameters - pose_parameters() of each view. Zero when there are none.
    double variance = 0.0;
    CameraParameters pull = CameraParameters::Zero();  // these deviations: BundleOptions::pull
    int iterations = 0;
    bool converged = false;         // the last step was below 1e-8 standard deviations
    double condition_number = 0.0;  // of the pose-eliminated Jacobian with columns of length 1
};

struct CameraStart {
    CameraModel camera;
    std::vector<Rigid> camera_from_target;  // one per view
};

struct CameraFitOptions {
    std::optional<CameraStart> start = std::nullopt;  // none: found from the views alone
    // Huber's function in place of the square beyond this distance of a point, in units of its
    // sigma; 0: least squares. For finding outliers; variance and equations are not meant for it.
    double huber = 0.0;
};

// The start without CameraFitOptions::start (calib/intrinsics/calibration_start.h) has a principal
// point in the middle of the image and no distortion; parameters that are not in `model` stay as in
// the start. Throws NumericalError for fewer than three views, a view that check_view() refuses
// with four points, more parameters than observations, a start that is none, and for views that do
// not determine the camera: a rank lost, or a focal length that noise of 0.1 px makes uncertain by
// more than a tenth; the combination of parameters that is weakest is named; of a telecentric lens
// planes all tilted about one axis, or by less than 5 degrees. Every observed point
// is where the model is regular (calib/camera/distortion.h); a fold between the axis and a point is
// for Projector to find.
CameraFit fit_camera(std::span<const CalibrationView> views, cv::Size image_size,
                     const CalibrationModel& model, const CameraFitOptions& options = {});

// Of the residuals in their points' sigmas.
double weighted_squares(std::span<const CalibrationView> views, const CameraFit& fit);

// The pose of a view of at least four points for a known camera; of the two mirrored solutions that
// a plane has, the one that fits better; of a telecentric camera either. Throws NumericalError when
// there is none.
Rigid fit_view_pose(const CameraModel& camera, const CalibrationView& view);

// Observed minus projected. Throws NumericalError for a point behind the camera or where the model
// is not regular.
std::vector<Eigen::Vector2d> view_residuals(const CameraModel& camera,
                                            const Rigid& camera_from_target,
                                            const CalibrationView& view);

// d pixel / d (parameters of the model) for a ray of any length, which the camera must see.
Eigen::Matrix2Xd parameter_jacobian(const CameraModel& camera, const Eigen::Vector3d& ray,
                                    const CalibrationModel& model);

// What one view says of the parameters once its own pose is eliminated: a change d of the
// parameters, with the best pose for each, leaves |triangle d - rhs|^2 + rest squared weighted px.
// Information triangle^T triangle, score triangle^T rhs. With its share of the pull.
struct ViewEquations {
    Eigen::MatrixXd triangle;  // upper triangular, parameters x parameters
    Eigen::VectorXd rhs;
    double rest = 0.0;
};

std::vector<ViewEquations> view_equations(std::span<const CalibrationView> views,
                                          const CameraFit& fit, const CalibrationModel& model);

// Inverse of the views' common information, from one more QR of their triangles: times the variance
// it is the formal covariance. Throws NumericalError, naming the weakest combination of parameters,
// when rank is lost.
Eigen::MatrixXd inverse_information(std::span<const ViewEquations> equations,
                                    const CalibrationModel& model);
// G, upper triangular up to the order of its rows, with G G^T that inverse.
Eigen::MatrixXd inverse_information_root(std::span<const ViewEquations> equations,
                                         const CalibrationModel& model);

// The weakest combination of the parameters, each in units of the change that alone moves the
// pixels by 1 px rms in total: "0.72 k1 - 0.55 k4 + 0.43 k2", largest first, parts below 0.1 left
// out; and the condition number that it makes.
struct WeakestDirection {
    std::string combination;
    double condition_number = 0.0;
};
WeakestDirection weakest_direction(std::span<const ViewEquations> equations,
                                   const CalibrationModel& model);

}  // namespace etalon
