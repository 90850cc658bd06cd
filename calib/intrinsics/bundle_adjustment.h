// The nonlinear least-squares problem of calib/intrinsics/camera_fit.h in any precision: double for
// use, long double to show what rounding does to it (`etalon stability`).
//
// Levenberg-Marquardt on the parameters of the camera, of which `free` may move, and a pose per
// view. Each view's Jacobian is brought to a triangle by Householder QR with the pose's
// columns first; what is below them is the view's say about the camera. Damped trials start from
// the triangles. Every iteration first tries the plain Gauss-Newton step, which converges in weak
// directions too; damping only helps where the model's curvature asks for it.
//
// No checks of the input: those are in calib/intrinsics/camera_fit.cpp.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "calib/camera/pixel_model.h"
#include "calib/intrinsics/calibration_view.h"
#include "core/geometry/rigid.h"

namespace etalon {

// Points are relative to their centroid: turning a target about a far origin would be nearly the
// same as moving it.
template <typename Scalar>
struct BundleView {
    Eigen::Vector3d centre_mm;
    Eigen::Matrix<Scalar, 3, Eigen::Dynamic> points_mm;
    Eigen::Matrix<Scalar, 2, Eigen::Dynamic> pixels;
    Eigen::Matrix<Scalar, Eigen::Dynamic, 1> weights;  // of a residual: 1 / sigma
};
template <typename Scalar>
BundleView<Scalar> bundle_view(const CalibrationView& view);

template <typename Scalar>
struct BundlePose {  // camera from centred target
    Eigen::Quaternion<Scalar> rotation;
    Eigen::Matrix<Scalar, 3, 1> translation;
};
template <typename Scalar>
BundlePose<Scalar> bundle_pose(const Rigid& camera_from_target, const Eigen::Vector3d& centre_mm);
template <typename Scalar>
Rigid rigid_from(const BundlePose<Scalar>& pose, const Eigen::Vector3d& centre_mm);

template <typename Scalar>
struct Bundle {
    LensProjection projection;
    typename PixelModel<Scalar>::Parameters camera;
    std::vector<BundlePose<Scalar>> poses;

    PixelModel<Scalar> model() const { return {projection, camera}; }
};

struct BundleOptions {
    std::vector<int> free;  // which parameters, in the order of the triangles' columns
    double huber = 0.0;
    int most_iterations = 100;
    // Of each parameter: weight of a further row of each view that wants it to be zero.
    PixelModel<double>::Parameters pull = PixelModel<double>::Parameters::Zero();
};

template <typename Scalar>
struct BundleSolution {
    Bundle<Scalar> bundle;
    Scalar cost;  // bundle_cost()
    int iterations = 0;
    bool converged = false;
};

// The sum of squares, or of Huber's function, with the pull's. Nothing as below.
template <typename Scalar>
std::optional<Scalar> bundle_cost(const std::vector<BundleView<Scalar>>& views,
                                  const Bundle<Scalar>& bundle, const BundleOptions& options);

// Nothing when the start puts a point where the model is not regular.
template <typename Scalar>
std::optional<BundleSolution<Scalar>> adjust_bundle(const std::vector<BundleView<Scalar>>& views,
                                                    const Bundle<Scalar>& start,
                                                    const BundleOptions& options);

// The view's residuals and Jacobian [pose | free parameters | residual], times an orthogonal matrix
// from the left: upper triangular, 6 + free + 1 rows and columns. Every point must be regular. A
// parameter of the pose that no pixel depends on has a 1 in its column, and does not move.
template <typename Scalar>
Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic> view_triangle(const BundleView<Scalar>& view,
                                                                    const PixelModel<Scalar>& model,
                                                                    const BundlePose<Scalar>& pose,
                                                                    const BundleOptions& options);

}  // namespace etalon
