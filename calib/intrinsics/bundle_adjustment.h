// The nonlinear least-squares problem of calib/intrinsics/camera_fit.h.
//
// Levenberg-Marquardt on a camera's `free` parameters and a pose per view. Householder QR brings
// each view's Jacobian to a triangle, pose first: the rows below are the camera's alone. Every
// iteration first tries the plain Gauss-Newton step, which converges in weak directions too. The
// input is checked in calib/intrinsics/camera_fit.cpp.
#pragma once

#include "calib/intrinsics/camera_fit.h"

namespace etalon {

// Points are relative to their centroid: about a far origin, turning is nearly the same as moving.
struct BundleView {
    Eigen::Vector3d centre_mm;
    Eigen::Matrix3Xd points_mm;
    Eigen::Matrix2Xd pixels;
    Eigen::VectorXd weights;  // of a residual: 1 / sigma
};
BundleView bundle_view(const CalibrationView& view);
std::vector<BundleView> bundle_views(std::span<const CalibrationView> views);

struct BundlePose {  // camera from centred target
    Eigen::Quaterniond rotation;
    Eigen::Vector3d translation;
};
BundlePose bundle_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm);
Rigid rigid_from(const BundlePose& pose, const Eigen::Vector3d& centre_mm);

struct Bundle {
    LensProjection projection;
    PixelModel<double>::Parameters camera;
    std::vector<BundlePose> poses;

    PixelModel<double> model() const { return {projection, camera}; }
};
Bundle bundle_of(const CameraModel& camera, std::span<const Rigid> camera_from_target,
                 const std::vector<BundleView>& views);
std::vector<Rigid> poses_of(const Bundle& bundle, const std::vector<BundleView>& views);

struct BundleOptions {
    std::vector<int> free;  // which parameters, in the order of the triangles' columns
    double huber = 0.0;
    int most_iterations = 100;
    // Of each parameter: weight of a further row of each view that wants it to be zero.
    PixelModel<double>::Parameters pull = PixelModel<double>::Parameters::Zero();
};

struct BundleSolution {
    Bundle bundle;
    double cost;  // bundle_cost()
    int iterations = 0;
    bool converged = false;
};

// The sum of squares, or of Huber's function, with the pull's. Nothing as below.
std::optional<double> bundle_cost(const std::vector<BundleView>& views, const Bundle& bundle,
                                  const BundleOptions& options);

// As a fit of the model, with its residuals without pull, variance and condition number.
CameraFit fit_from(const BundleSolution& solution, const CalibrationModel& model,
                   std::span<const CalibrationView> views,
                   const std::vector<BundleView>& bundle_views, CameraModel camera);

// Nothing when the start puts a point where the model is not regular.
std::optional<BundleSolution> adjust_bundle(const std::vector<BundleView>& views,
                                            const Bundle& start, const BundleOptions& options);

// d pixel / d left perturbation of the pose, of a point at `turned` + translation, of d pixel / d
// that point.
Eigen::Matrix<double, 2, 6> pose_jacobian(const Eigen::Matrix<double, 2, 3>& of_point,
                                          const Eigen::Vector3d& turned);

// The view's residuals and Jacobian [pose | free parameters | residual], times an orthogonal matrix
// from the left: upper triangular, 6 + free + 1 rows and columns. Every point must be regular. A
// parameter of the pose that no pixel depends on has a 1 in its column, and does not move.
Eigen::MatrixXd view_triangle(const BundleView& view, const PixelModel<double>& model,
                              const BundlePose& pose, const BundleOptions& options);

}  // namespace etalon
