// Bundle adjustment: the camera and poses of planar targets whose projected points are closest to
// the observed pixels (least squares). Triggs et al., "Bundle Adjustment - A Modern Synthesis"
// (2000); Bjorck, "Numerical Methods for Least Squares Problems" (1996). Householder QR eliminates
// the poses, so that the condition number counts once and not squared.
//
// Telecentric poses keep their start's distance. Thread-safe, deterministic, single-threaded. Eight
// views of 54 points: 1.3 ms from a start nearby, 9 ms from nothing. Standard deviations:
// calib/intrinsics/calibration_covariance.h.
#pragma once

#include "calib/intrinsics/calibration_model.h"
#include "calib/intrinsics/calibration_view.h"
#include "core/geometry/rigid.h"

namespace etalon {

// Photos may hardly tell richer models apart: k1 = k4 + 1000 fits as well where points do not reach
// far, and tau_y does at first order what p2 = -s1 = tau_y / 2 do. So k4 to k6, the prism and the
// tilts have normal priors about zero, with room to spare. Standard deviations of what each does at
// the outermost point, relative to its distance from the axis.
inline constexpr double rational_deviation = 0.5, prism_deviation = 0.004, tilt_deviation = 0.02;

struct CameraFit {
    CalibrationModel model;
    CameraModel camera;  // without covariance; its image size is that of the views
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

    double rms_px() const;  // over all points, of the distance in the image
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

// Without CameraFitOptions::start the principal point is the image's middle, without distortion;
// parameters not in `model` keep the start's. Throws NumericalError for fewer than three views, a
// view that check_view() refuses with four points, more parameters than observations, an impossible
// start, and what check_identifiability() refuses. Every observed point is where the model is
// regular; a fold between the axis and a point is for Projector to find.
CameraFit fit_camera(std::span<const CalibrationView> views, cv::Size image_size,
                     const CalibrationModel& model, const CameraFitOptions& options = {});

// The same model again, started from the fit's camera and these poses, one per view.
CameraFit refit_camera(std::span<const CalibrationView> views, const CameraFit& fit,
                       std::vector<Rigid> poses);

double sum_of_squares(std::span<const Eigen::Vector2d> residuals);
// Of the residuals in their points' sigmas.
double weighted_squares(std::span<const CalibrationView> views, const CameraFit& fit);

// The pose of a view of at least four points for a known camera: of a plane's two mirrored
// solutions the better one (telecentric: either). Throws NumericalError when there is none.
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
                                          const CameraFit& fit);

// G with G G^T the inverse of the views' information, from one more QR; upper triangular up to the
// order of rows. Times the variance: the formal covariance. Throw NumericalError, naming the
// weakest combination of parameters, when rank is lost.
Eigen::MatrixXd inverse_information_root(std::span<const ViewEquations> equations,
                                         const CalibrationModel& model);
Eigen::MatrixXd inverse_information(std::span<const ViewEquations> equations,
                                    const CalibrationModel& model);

// In units of the change that alone moves the pixels by 1 px rms in total: "0.72 k1 - 0.55 k4 +
// 0.43 k2", largest first, from 0.1 on; and its condition number.
struct WeakestDirection {
    std::string combination;
    double condition_number = 0.0;
};
WeakestDirection weakest_direction(std::span<const ViewEquations> equations,
                                   const CalibrationModel& model);

}  // namespace etalon
