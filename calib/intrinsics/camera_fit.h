// Bundle adjustment of one camera and the poses of planar targets: the intrinsics and poses that
// bring the projected points closest to the observed pixels, in the sense of least squares.
//
// Triggs et al., "Bundle Adjustment - A Modern Synthesis" (2000); Bjorck, "Numerical Methods for
// Least Squares Problems" (1996). Levenberg-Marquardt with scaled columns. Every view's pose is
// eliminated by Householder QR, so that the condition number counts once and not squared.
//
// A telecentric camera's poses keep the distance that they start with. Thread-safe, deterministic,
// single-threaded. Eight views of 54 points cost 1.3 ms from a start nearby and 9 ms from nothing,
// nine parameters free. Standard deviations: calib/intrinsics/calibration_covariance.h.
#pragma once

#include "calib/intrinsics/calibration_model.h"
#include "calib/intrinsics/calibration_view.h"
#include "core/geometry/rigid.h"

namespace etalon {

// What richer models add, photos may hardly tell apart: k1 = k4 + 1000 fits as well as any where
// the points do not reach far, and a tilt tau_y does at first order what p2 = -s1 = tau_y / 2 do.
// So k4 to k6, the prism's coefficients and the tilts have normal priors about zero, as wide as
// lenses and sensors make them with room to spare. These are the standard deviations of what each
// does at the outermost point, relative to that point's distance from the axis.
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

// The start without CameraFitOptions::start (calib/intrinsics/calibration_start.h) has a principal
// point in the middle of the image and no distortion; parameters that are not in `model` stay as in
// the start. Throws NumericalError for fewer than three views, a view that check_view() refuses
// with four points, more parameters than observations, a start that is none, and what
// check_identifiability() refuses. Every observed point is where the model is regular
// (calib/camera/distortion.h); a fold between the axis and a point is for Projector to find.
CameraFit fit_camera(std::span<const CalibrationView> views, cv::Size image_size,
                     const CalibrationModel& model, const CameraFitOptions& options = {});

// The same model again, started from the fit's camera and these poses, one per view.
CameraFit refit_camera(std::span<const CalibrationView> views, const CameraFit& fit,
                       std::vector<Rigid> poses);

double sum_of_squares(std::span<const Eigen::Vector2d> residuals);
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
                                          const CameraFit& fit);

// G with G G^T the inverse of the views' common information, from one more QR of their triangles;
// upper triangular up to the order of its rows. That inverse times the variance is the formal
// covariance. Throw NumericalError, naming the weakest combination of parameters, when rank is
// lost.
Eigen::MatrixXd inverse_information_root(std::span<const ViewEquations> equations,
                                         const CalibrationModel& model);
Eigen::MatrixXd inverse_information(std::span<const ViewEquations> equations,
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
