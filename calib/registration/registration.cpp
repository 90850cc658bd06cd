#include "calib/registration/registration.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/registration/registration_gauge.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using Points = std::vector<Eigen::Vector3d>;
using Poses = std::span<const RegistrationPose>;
using Matrix2x6 = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;

// ---------------------------------------------------------------------------------------- input

void require_usable(const Points& points, Poses poses, const Rigid& nominal) {
    require_enough_poses(poses.size());
    if (points.size() < 3)
        throw NumericalError("registration: the marker needs at least 3 points");
    bool finite = vector_from_rigid(nominal).allFinite();
    for (const Eigen::Vector3d& point : points)
        finite = finite && point.allFinite();
    for (const RegistrationPose& pose : poses) {
        if (pose.pixels.size() != points.size())
            throw NumericalError(fmt::format("registration: {} pixels for a marker of {} points",
                                             pose.pixels.size(), points.size()));
        finite = finite && vector_from_rigid(pose.base_from_carriage).allFinite() &&
                 vector_from_rigid(pose.camera_from_marker).allFinite() &&
                 std::isfinite(pose.sigma_px) && pose.sigma_px > 0.0;
        for (const Eigen::Vector2d& pixel : pose.pixels)
            finite = finite && pixel.allFinite();
    }
    if (!finite)
        throw NumericalError("registration: a value is not finite or a sigma is not positive");
}

std::vector<PosePair> pairs_of(Poses poses) {
    std::vector<PosePair> pairs;
    for (const RegistrationPose& pose : poses)
        pairs.push_back({pose.base_from_carriage, pose.camera_from_marker});
    return pairs;
}

std::vector<RegistrationPose> with_transforms(Poses poses, const std::vector<Rigid>& transforms) {
    std::vector<RegistrationPose> result(poses.begin(), poses.end());
    for (std::size_t i = 0; i < result.size(); ++i)
        result[i].base_from_carriage = transforms[i];
    return result;
}

// ------------------------------------------------------------------------------ one marker point

struct PointDerivatives {
    Eigen::Vector2d pixel;
    Matrix2x6 by_x, by_y;
};

// p_camera = X S Y p. A left perturbation (w, v) of X moves it by w x (R_X S Y p) + v; one of Y
// does the same in the carriage.
std::optional<PointDerivatives> point_derivatives(const Projector& projector,
                                                  const Eigen::Vector3d& p_marker, const XY& xy,
                                                  const Rigid& base_from_carriage) {
    const Rigid& x = xy.camera_from_base;
    const Rigid& y = xy.carriage_from_marker;
    const Eigen::Vector3d turned_in_carriage = y.rotation * p_marker;
    const Eigen::Vector3d turned_in_camera =
        x.rotation * (base_from_carriage * (turned_in_carriage + y.translation));
    const std::optional<Projected> projected =
        projector.project_with_jacobian(turned_in_camera + x.translation);
    if (!projected)
        return std::nullopt;
    const Eigen::Matrix<double, 2, 3> by_carriage =
        projected->jacobian * (x.rotation * base_from_carriage.rotation).toRotationMatrix();
    PointDerivatives result;
    result.pixel = projected->pixel;
    result.by_x << -projected->jacobian * cross_matrix(turned_in_camera), projected->jacobian;
    result.by_y << -by_carriage * cross_matrix(turned_in_carriage), by_carriage;
    return result;
}

// ---------------------------------------------------------------------------------------- solver

// Two rows a point, in standard deviations; nothing where a point has no projection.
std::optional<ResidualsAndJacobian> linearised(const Projector& projector, const Points& points,
                                               Poses poses, const XY& xy) {
    const Eigen::Index rows = 2 * std::ssize(points) * std::ssize(poses);
    ResidualsAndJacobian all{Eigen::VectorXd(rows), Eigen::MatrixXd(rows, 12)};
    Eigen::Index row = 0;
    for (const RegistrationPose& pose : poses)
        for (std::size_t i = 0; i < points.size(); ++i, row += 2) {
            const auto point = point_derivatives(projector, points[i], xy, pose.base_from_carriage);
            if (!point)
                return std::nullopt;
            all.residuals.segment<2>(row) = (point->pixel - pose.pixels[i]) / pose.sigma_px;
            all.jacobian.middleRows<2>(row) << point->by_x / pose.sigma_px,
                point->by_y / pose.sigma_px;
        }
    return all;
}

// ------------------------------------------------------------------------------------- residuals

// Residual length of every point, in standard deviations.
std::vector<double> residual_lengths(const Projector& projector, const Points& points, Poses poses,
                                     const XY& xy) {
    std::vector<double> lengths;
    for (const RegistrationPose& pose : poses) {
        const Rigid camera_from_marker =
            xy.camera_from_base * pose.base_from_carriage * xy.carriage_from_marker;
        for (std::size_t i = 0; i < points.size(); ++i) {
            const auto pixel = projector.project(camera_from_marker * points[i]);
            if (!pixel)
                throw NumericalError(
                    "registration: the marker is predicted outside the camera's valid region");
            lengths.push_back((*pixel - pose.pixels[i]).norm() / pose.sigma_px);
        }
    }
    return lengths;
}

// 3 standard deviations, estimated from the median length of two-dimensional normal residuals
// (sigma sqrt(2 ln 2)). The floor keeps exact data from being held for outliers.
double huber_threshold(std::vector<double> lengths) {
    const auto middle = lengths.begin() + std::ssize(lengths) / 2;
    std::nth_element(lengths.begin(), middle, lengths.end());
    return 3.0 * std::max(*middle / std::sqrt(2.0 * std::numbers::ln2), 1e-6);
}

struct RobustSolution {
    XY xy;
    double huber_threshold = 0.0;
};

RobustSolution robust_solution(const Projector& projector, const Points& points, Poses poses,
                               const XY& start) {
    RobustSolution solution{start};
    for (int round = 0; round < 3; ++round) {  // the threshold settles
        solution.huber_threshold =
            huber_threshold(residual_lengths(projector, points, poses, solution.xy));
        solution.xy =
            minimised(solution.xy, {.group = 2, .huber = solution.huber_threshold},
                      [&](const XY& at) { return linearised(projector, points, poses, at); });
    }
    return solution;
}

void summarize_residuals(const std::vector<double>& lengths, Poses poses, double threshold,
                         Registration& result) {
    const std::size_t points = lengths.size() / poses.size();
    double sum = 0.0, weighted = 0.0;
    for (std::size_t i = 0; i < lengths.size(); ++i) {
        sum += std::pow(lengths[i] * poses[i / points].sigma_px, 2);
        weighted += lengths[i] * lengths[i];
        result.down_weighted_points += lengths[i] > threshold ? 1 : 0;
    }
    const double coordinates = 2.0 * static_cast<double>(lengths.size());
    result.residual_rms_px = std::sqrt(sum / coordinates);
    result.reduced_squares = weighted / (coordinates - result.rank);
}

RegistrationJacobian whole_jacobian(const Projector& projector, const Points& points, Poses poses,
                                    const XY& xy) {
    const auto all = linearised(projector, points, poses, xy);
    if (!all)
        throw NumericalError("registration: a marker point has no projection");
    return all->jacobian;
}

}  // namespace

Eigen::Matrix<double, Eigen::Dynamic, 12> registration_jacobian(
    const Projector& projector, const std::vector<Eigen::Vector3d>& points_mm,
    const Rigid& camera_from_base, const Rigid& base_from_carriage,
    const Rigid& carriage_from_marker) {
    RegistrationJacobian jacobian(2 * std::ssize(points_mm), 12);
    for (std::size_t i = 0; i < points_mm.size(); ++i) {
        const auto point = point_derivatives(
            projector, points_mm[i], {camera_from_base, carriage_from_marker}, base_from_carriage);
        if (!point)
            throw NumericalError("registration: a marker point has no projection");
        jacobian.middleRows<2>(2 * static_cast<Eigen::Index>(i)) << point->by_x, point->by_y;
    }
    return jacobian;
}

Registration register_stage(const Projector& projector,
                            const std::vector<Eigen::Vector3d>& points_mm,
                            std::span<const RegistrationPose> given,
                            const Rigid& nominal_carriage_from_marker) {
    require_point_of_view(projector.camera(), "registration");
    require_usable(points_mm, given, nominal_carriage_from_marker);
    const StageMotion motion = required_motion(pairs_of(given));
    const std::vector<RegistrationPose> poses = with_transforms(given, motion.without_noise);
    const RobustSolution solution =
        robust_solution(projector, points_mm, poses, registration_seed(pairs_of(poses)));
    Registration result = with_freedoms_fixed(
        solution.xy, motion, nominal_carriage_from_marker,
        [&](const XY& xy) { return whole_jacobian(projector, points_mm, poses, xy); });
    const XY xy{result.camera_from_base, result.carriage_from_marker};
    summarize_residuals(residual_lengths(projector, points_mm, poses, xy), poses,
                        solution.huber_threshold, result);
    return result;
}

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
