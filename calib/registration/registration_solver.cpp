#include "calib/registration/registration_solver.h"

#include <fmt/format.h>

#include <Eigen/Dense>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr std::size_t min_poses = 4;

// See the header.
class SeedSystem {
public:
    void add_position(const Eigen::Vector3d& s, const PosePair& pose) {
        Row row = by_m(s);
        row.middleCols<3>(9) = pose.camera_from_marker.rotation.toRotationMatrix();
        row.middleCols<3>(12).setIdentity();
        rows_.push_back(row);
        values_.push_back(pose.camera_from_marker.translation);
    }

    // Rotations near half a turn have no sure sign, tiny ones are noise: both are left out.
    void add_rotation(const PosePair& one, const PosePair& two) {
        constexpr double arm_mm = 100.0;  // weighs a rotation like the motion of a marker's edge
        const Eigen::Vector3d base = rotation_vector(two.base_from_carriage.rotation *
                                                     one.base_from_carriage.rotation.conjugate());
        if (base.norm() < 0.01 || base.norm() > 2.8)
            return;
        rows_.push_back(by_m(arm_mm * base));
        values_.push_back(arm_mm * rotation_vector(two.camera_from_marker.rotation *
                                                   one.camera_from_marker.rotation.conjugate()));
    }

    // Minimum-norm solution in scaled columns: what nothing determines stays zero, and the prior
    // decides about it later.
    Eigen::Matrix<double, 15, 1> solve() const {
        Eigen::MatrixXd a(3 * std::ssize(rows_), 15);
        Eigen::VectorXd b(3 * std::ssize(rows_));
        for (std::size_t i = 0; i < rows_.size(); ++i) {
            a.middleRows<3>(3 * static_cast<Eigen::Index>(i)) = rows_[i];
            b.segment<3>(3 * static_cast<Eigen::Index>(i)) = values_[i];
        }
        Eigen::VectorXd unscale = a.colwise().norm();
        for (double& s : unscale)
            s = s > 0.0 ? 1.0 / s : 0.0;
        Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> decomposition;
        decomposition.setThreshold(1e-3);
        decomposition.compute(a * unscale.asDiagonal());
        return unscale.asDiagonal() * Eigen::VectorXd(decomposition.solve(b));
    }

private:
    using Row = Eigen::Matrix<double, 3, 15>;

    static Row by_m(const Eigen::Vector3d& v) {  // d (M v) / d M, column by column
        Row row = Row::Zero();
        for (int column = 0; column < 3; ++column)
            row.middleCols<3>(3 * column) = v[column] * Eigen::Matrix3d::Identity();
        return row;
    }

    std::vector<Row> rows_;
    std::vector<Eigen::Vector3d> values_;
};

Eigen::Quaterniond nearest_rotation(const Eigen::Matrix3d& m) {
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Eigen::Matrix3d product = svd.matrixU() * svd.matrixV().transpose();
    const double sign = product.determinant() < 0.0 ? -1.0 : 1.0;
    return Eigen::Quaterniond(Eigen::Matrix3d(
        svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose()));
}

// Where the marker is on average, base frame.
Eigen::Vector3d middle_of(std::span<const Rigid> stage, const XY& xy) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Rigid& base_from_carriage : stage)
        sum += base_from_carriage * xy.carriage_from_marker.translation;
    return sum / static_cast<double>(stage.size());
}

}  // namespace

XY registration_seed(std::span<const PosePair> poses) {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const PosePair& pose : poses)
        centre += pose.base_from_carriage.translation / static_cast<double>(poses.size());
    SeedSystem system;
    for (std::size_t i = 0; i < poses.size(); ++i) {
        system.add_position(poses[i].base_from_carriage.translation - centre, poses[i]);
        if (i > 0)
            system.add_rotation(poses[i - 1], poses[i]);
        if (i > 1)
            system.add_rotation(poses[0], poses[i]);
    }
    const Eigen::Matrix<double, 15, 1> solution = system.solve();
    XY xy;
    xy.camera_from_base.rotation =
        nearest_rotation(Eigen::Map<const Eigen::Matrix3d>(solution.data()));
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const PosePair& pose : poses)
        sum += (pose.base_from_carriage.rotation.conjugate() *
                xy.camera_from_base.rotation.conjugate() * pose.camera_from_marker.rotation)
                   .toRotationMatrix();
    xy.carriage_from_marker.rotation = nearest_rotation(sum);
    xy.carriage_from_marker.translation =
        xy.carriage_from_marker.rotation * Eigen::Vector3d(solution.segment<3>(9));
    xy.camera_from_base.translation = solution.tail<3>() - xy.camera_from_base.rotation * centre;
    return xy;
}

void require_enough_poses(std::size_t poses) {
    if (poses < min_poses)
        throw NumericalError(
            fmt::format("registration: {} poses, at least {} are needed", poses, min_poses));
}

StageMotion required_motion(std::span<const PosePair> poses) {
    std::vector<Rigid> plan;
    for (const PosePair& pose : poses)
        plan.push_back(pose.base_from_carriage);
    const StageMotion motion = stage_motion(plan);
    if (motion.kind == MotionKind::none)
        throw NumericalError(fmt::format(
            "registration: the stage did not move: {} poses, all the same", poses.size()));
    if (motion.distinct_poses < static_cast<int>(min_poses))
        throw NumericalError(
            fmt::format("registration: {} poses, but only {} distinct ones, at least {} are needed",
                        poses.size(), motion.distinct_poses, min_poses));
    return motion;
}

XY minimised(const XY& start, const LeastSquaresRule& rule,
             const std::function<std::optional<ResidualsAndJacobian>(const XY&)>& linearised) {
    const auto moved = [](const XY& xy, const Eigen::VectorXd& step) {
        return std::optional(XY{left_perturbed(xy.camera_from_base, step.head<6>()),
                                left_perturbed(xy.carriage_from_marker, step.tail<6>())});
    };
    // A gain of 1e-16 is 1e-8 of a standard deviation; rounding alone promises 1e-20.
    LeastSquaresRule until = rule;
    until.descent.enough_gain = 1e-16;
    const auto found = least_squares(start, until, linearised, moved);
    if (!found || !found->converged)
        throw NumericalError("registration did not converge");
    return found->place.unknowns;
}

Registration with_freedoms_fixed(
    const XY& solution, const StageMotion& motion, const Rigid& nominal_carriage_from_marker,
    const std::function<RegistrationJacobian(const XY&)>& jacobian_at) {
    const std::vector<Rigid>& stage = motion.without_noise;
    const RegistrationRank rank = registration_rank(jacobian_at(solution), solution);
    const XY xy =
        nearest_to_prior(solution, rank.freedoms, stage.front(), nominal_carriage_from_marker);
    Registration result{xy.camera_from_base, xy.carriage_from_marker};
    result.rank = rank.rank;
    result.condition_number = rank.condition_number;
    result.motion = motion.words;
    for (const Twist& twist : rank.freedoms)
        result.freedoms.push_back(gauge_freedom(twist, xy, stage.front()));
    const RegistrationJacobian jacobian = jacobian_at(xy);
    result.covariance = constrained_covariance(jacobian, result.freedoms);
    result.weak = weak_directions(jacobian, xy, rank.freedoms, middle_of(stage, xy), stage.size());
    if (!result.covariance.allFinite() || !vector_from_rigid(result.camera_from_base).allFinite() ||
        !vector_from_rigid(result.carriage_from_marker).allFinite())
        throw NumericalError("registration gave a value that is not finite");
    return result;
}

}  // namespace etalon
