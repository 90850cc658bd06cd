#include "compare/photometric_pose.h"

#include <Eigen/Eigenvalues>

#include "core/errors.h"

namespace etalon {
namespace {

// The pose's part of the inverse, rows and columns scaled to a unit diagonal first.
Matrix6d pose_covariance(const Eigen::MatrixXd& information) {
    constexpr double least = 1e-13;  // of the largest eigenvalue: beyond, only rounding is left
    const Eigen::VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scale.asDiagonal() * information *
                                                                scale.asDiagonal());
    const Eigen::VectorXd& values = solver.eigenvalues();
    if (!scale.allFinite() || solver.info() != Eigen::Success ||
        !(values[0] > least * values[values.size() - 1]))
        throw NumericalError("the photograph does not determine pose and photometric model");
    const Eigen::MatrixXd inverse = scale.asDiagonal() * solver.eigenvectors() *
                                    values.cwiseInverse().asDiagonal() *
                                    solver.eigenvectors().transpose() * scale.asDiagonal();
    return inverse.topLeftCorner<6, 6>();
}

}  // namespace

PhotometricPose photometric_pose(const PhotoOfMarker& photo,
                                 std::shared_ptr<const PhotometricCamera> camera,
                                 const PhotoState& start, const PhotometricTerms& terms) {
    const bool knows_noise = camera->knows_noise();
    const PhotometricAdjustment fit =
        adjust_to_photos({&photo, 1}, std::move(camera), {&start, 1}, terms, {});
    const PhotoEquations& equations = fit.equations.front();
    const double freedom = equations.pixels - 6.0 - terms.count();

    PhotometricPose pose;
    pose.camera_from_marker = fit.photos.front().camera_from_marker;
    pose.photometry = fit.photos.front().photometry;
    pose.photometry.pixels = equations.pixels;
    pose.noise_scale = fit.noise_scales.front();
    pose.reduced_squares = equations.squares / freedom;
    const double variance =
        knows_noise ? std::max(pose.reduced_squares, 1.0) : pose.reduced_squares;
    pose.covariance = variance * pose_covariance(equations.information);
    pose.loss = equations.loss;
    pose.pixels = equations.pixels;
    pose.iterations = fit.iterations;
    pose.converged = fit.converged;
    return pose;
}

}  // namespace etalon
