#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "calib/registration/registration_solver.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using Matrix6x12 = Eigen::Matrix<double, 6, 12>;

// d log(Exp(d) Exp(r)) / d d at d = 0: the inverse left Jacobian of SO(3) (Barfoot, State
// Estimation for Robotics, 7.1.5). r is a residual, far from half a turn.
Eigen::Matrix3d by_left_turn(const Eigen::Vector3d& r) {
    const double angle = r.norm();
    const Eigen::Matrix3d k = cross_matrix(r);
    // Below the threshold the next term of the series, r^2 / 720, is under 1e-10.
    const double second =
        angle < 2e-4 ? 1.0 / 12.0 : (1.0 - 0.5 * angle / std::tan(0.5 * angle)) / (angle * angle);
    return Eigen::Matrix3d::Identity() - 0.5 * k + second * k * k;
}

// X S Y against the measured pose, and how it changes with X and Y. Rotation: X S Y turns by w_X
// and by R_X R_S w_Y; translation: R_X (S t_Y) + t_X.
struct Difference {
    Vector6d value;
    Matrix6x12 slope;
};

Difference difference(const MeasuredPose& pose, const XY& xy) {
    const Rigid predicted = xy.camera_from_base * pose.base_from_carriage * xy.carriage_from_marker;
    const Eigen::Matrix3d turn =
        (xy.camera_from_base.rotation * pose.base_from_carriage.rotation).toRotationMatrix();
    Difference result{left_difference(pose.camera_from_marker, predicted), Matrix6x12::Zero()};
    const Eigen::Matrix3d by_turn = by_left_turn(result.value.head<3>());
    result.slope.topLeftCorner<3, 3>() = by_turn;
    result.slope.block<3, 3>(0, 6) = by_turn * turn;
    result.slope.bottomLeftCorner<3, 3>() =
        -cross_matrix(predicted.translation - xy.camera_from_base.translation);
    result.slope.block<3, 3>(3, 3).setIdentity();
    result.slope.block<3, 3>(3, 9) = turn;
    return result;
}

// Takes a difference to standard deviations: L^-1 with covariance = L L^T.
Matrix6d whitening_of(const Matrix6d& covariance) {
    const Eigen::LLT<Eigen::MatrixXd> root(covariance);
    if (!covariance.allFinite() || root.info() != Eigen::Success)
        throw NumericalError("registration: the covariance of a pose is not positive definite");
    return root.matrixL().solve(Eigen::MatrixXd::Identity(6, 6));
}

struct WeightedPose {
    MeasuredPose pose;
    Matrix6d whitening;
};

std::vector<WeightedPose> weighted_poses(std::span<const MeasuredPose> poses,
                                         const Rigid& nominal) {
    require_enough_poses(poses.size());
    bool finite = vector_from_rigid(nominal).allFinite();
    std::vector<WeightedPose> weighted;
    for (const MeasuredPose& pose : poses) {
        finite = finite && vector_from_rigid(pose.base_from_carriage).allFinite() &&
                 vector_from_rigid(pose.camera_from_marker).allFinite();
        weighted.push_back({pose, whitening_of(pose.covariance)});
    }
    if (!finite)
        throw NumericalError("registration: a value is not finite");
    return weighted;
}

std::vector<PosePair> pairs_of(const std::vector<WeightedPose>& poses) {
    std::vector<PosePair> pairs;
    for (const WeightedPose& one : poses)
        pairs.push_back({one.pose.base_from_carriage, one.pose.camera_from_marker});
    return pairs;
}

// In standard deviations.
std::vector<double> distances(const std::vector<WeightedPose>& poses, const XY& xy) {
    std::vector<double> all;
    for (const WeightedPose& one : poses)
        all.push_back((one.whitening * difference(one.pose, xy).value).norm());
    return all;
}

// The length of six normal deviates has the median 2.313 and exceeds 4.08 in 1.1 % of cases, as
// that of two exceeds 3 (chi-square of 6 and of 2 degrees of freedom).
double pose_huber_threshold(std::vector<double> lengths) {
    const auto middle = lengths.begin() + std::ssize(lengths) / 2;
    std::nth_element(lengths.begin(), middle, lengths.end());
    return 4.08 * std::max(*middle / 2.313, 1e-6);
}

// In standard deviations.
ResidualsAndJacobian linearised(const std::vector<WeightedPose>& poses, const XY& xy) {
    const Eigen::Index rows = 6 * std::ssize(poses);
    ResidualsAndJacobian all{Eigen::VectorXd(rows), Eigen::MatrixXd(rows, 12)};
    for (std::size_t i = 0; i < poses.size(); ++i) {
        const Difference one = difference(poses[i].pose, xy);
        const auto row = 6 * static_cast<Eigen::Index>(i);
        all.residuals.segment<6>(row) = poses[i].whitening * one.value;
        all.jacobian.middleRows<6>(row) = poses[i].whitening * one.slope;
    }
    return all;
}

}  // namespace

Registration register_stage_on_poses(std::span<const MeasuredPose> given,
                                     const Rigid& nominal_carriage_from_marker) {
    std::vector<WeightedPose> poses = weighted_poses(given, nominal_carriage_from_marker);
    const StageMotion motion = required_motion(pairs_of(poses));
    for (std::size_t i = 0; i < poses.size(); ++i)
        poses[i].pose.base_from_carriage = motion.without_noise[i];
    XY xy = registration_seed(pairs_of(poses));
    double threshold = 0.0;
    for (int round = 0; round < 3; ++round) {  // the threshold settles
        threshold = pose_huber_threshold(distances(poses, xy));
        xy = minimised(xy, {.group = 6, .huber = threshold},
                       [&](const XY& at) { return linearised(poses, at); });
    }
    Registration result =
        with_freedoms_fixed(xy, motion, nominal_carriage_from_marker,
                            [&](const XY& at) { return linearised(poses, at).jacobian; });
    for (const double distance :
         distances(poses, {result.camera_from_base, result.carriage_from_marker})) {
        result.reduced_squares += distance * distance;
        result.down_weighted_points += distance > threshold ? 1 : 0;
    }
    result.reduced_squares /= 6.0 * static_cast<double>(poses.size()) - result.rank;
    return result;
}

}  // namespace etalon
