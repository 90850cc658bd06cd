#include "calib/registration.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <Eigen/Dense>
#include <numbers>

#include "calib/registration_gauge.h"
#include "calib/stage_motion.h"
#include "core/errors.h"

namespace etalon {
namespace {

using Points = std::vector<Eigen::Vector3d>;
using Poses = std::span<const RegistrationPose>;
using Matrix2x6 = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;

constexpr int min_poses = 4;

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
    Eigen::Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

// ---------------------------------------------------------------------------------------- input

void require_usable(const Points& points, Poses poses, const Rigid& nominal) {
    if (poses.size() < min_poses)
        throw NumericalError(
            fmt::format("registration: {} poses, at least {} are needed", poses.size(), min_poses));
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

StageMotion required_motion(Poses poses) {
    std::vector<Rigid> plan;
    for (const RegistrationPose& pose : poses)
        plan.push_back(pose.base_from_carriage);
    const StageMotion motion = stage_motion(plan);
    if (motion.kind == MotionKind::none)
        throw NumericalError(fmt::format(
            "registration: the stage did not move: {} poses, all the same", poses.size()));
    if (motion.distinct_poses < min_poses)
        throw NumericalError(
            fmt::format("registration: {} poses, but only {} distinct ones, at least {} are needed",
                        poses.size(), motion.distinct_poses, min_poses));
    return motion;
}

std::vector<RegistrationPose> with_transforms(Poses poses, const std::vector<Rigid>& transforms) {
    std::vector<RegistrationPose> result(poses.begin(), poses.end());
    for (std::size_t i = 0; i < result.size(); ++i)
        result[i].base_from_carriage = transforms[i];
    return result;
}

// ----------------------------------------------------------------------------------------- seed

// Linear in M (camera_from_base's rotation, not yet orthogonal), w = R_Y^T t_Y and t = t_X:
//     M s_i + R_i w + t = t_i            what the marker's origin does
//     M log(S_i S_j^T) = log(R_i R_j^T)  what rotations do
// with (S_i, s_i) = base_from_carriage and (R_i, t_i) = camera_from_marker. Unlike the closed-form
// hand-eye methods it needs no particular set of axes.
class SeedSystem {
public:
    void add_position(const Eigen::Vector3d& s, const RegistrationPose& pose) {
        Row row = by_m(s);
        row.middleCols<3>(9) = pose.camera_from_marker.rotation.toRotationMatrix();
        row.middleCols<3>(12).setIdentity();
        rows_.push_back(row);
        values_.push_back(pose.camera_from_marker.translation);
    }

    // Rotations near half a turn have no sure sign, tiny ones are noise: both are left out.
    void add_rotation(const RegistrationPose& one, const RegistrationPose& two) {
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
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
    const Eigen::Matrix3d product = svd.matrixU() * svd.matrixV().transpose();
    const double sign = product.determinant() < 0.0 ? -1.0 : 1.0;
    return Eigen::Quaterniond(Eigen::Matrix3d(
        svd.matrixU() * Eigen::Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose()));
}

XY seed(Poses poses) {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const RegistrationPose& pose : poses)
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
    for (const RegistrationPose& pose : poses)
        sum += (pose.base_from_carriage.rotation.conjugate() *
                xy.camera_from_base.rotation.conjugate() * pose.camera_from_marker.rotation)
                   .toRotationMatrix();
    xy.carriage_from_marker.rotation = nearest_rotation(sum);
    xy.carriage_from_marker.translation =
        xy.carriage_from_marker.rotation * Eigen::Vector3d(solution.segment<3>(9));
    xy.camera_from_base.translation = solution.tail<3>() - xy.camera_from_base.rotation * centre;
    return xy;
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

// A Rigid as Ceres sees it: quaternion x y z w, then translation; its tangent is our left
// perturbation. The cost functions give derivatives by that tangent in their first six columns, so
// the manifold's own Jacobian is the identity above a zero row.
class LeftPerturbation final : public ceres::Manifold {
public:
    int AmbientSize() const override { return 7; }
    int TangentSize() const override { return 6; }

    bool Plus(const double* x, const double* delta, double* result) const override {
        write(left_perturbed(read(x), Eigen::Map<const Vector6d>(delta)), result);
        return true;
    }
    bool PlusJacobian(const double*, double* jacobian) const override {
        Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> j(jacobian);
        j.setZero();
        j.topRows<6>().setIdentity();
        return true;
    }
    bool Minus(const double* y, const double* x, double* delta) const override {
        Eigen::Map<Vector6d> result(delta);
        result = left_difference(read(x), read(y));
        return true;
    }
    bool MinusJacobian(const double*, double* jacobian) const override {
        Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobian);
        j.setZero();
        j.leftCols<6>().setIdentity();
        return true;
    }

    static Rigid read(const double* x) {
        return {Eigen::Quaterniond(x[3], x[0], x[1], x[2]).normalized(), {x[4], x[5], x[6]}};
    }
    static void write(const Rigid& transform, double* x) {
        Eigen::Map<Eigen::Vector4d> rotation(x);
        Eigen::Map<Eigen::Vector3d> translation(x + 4);
        rotation = transform.rotation.coeffs();
        translation = transform.translation;
    }
};

// One point in one pose: two residuals in standard deviations.
class PointCost final : public ceres::SizedCostFunction<2, 7, 7> {
public:
    PointCost(const Projector& projector, const RegistrationPose& pose,
              const Eigen::Vector3d& p_marker, const Eigen::Vector2d& pixel)
        : projector_(projector), pose_(pose), p_marker_(p_marker), pixel_(pixel) {}

    // False, which makes Ceres take a shorter step, where the point has no projection.
    bool Evaluate(double const* const* parameters, double* residuals,
                  double** jacobians) const override {
        const std::optional<PointDerivatives> point = point_derivatives(
            projector_, p_marker_,
            {LeftPerturbation::read(parameters[0]), LeftPerturbation::read(parameters[1])},
            pose_.base_from_carriage);
        if (!point)
            return false;
        Eigen::Map<Eigen::Vector2d> residual(residuals);
        residual = (point->pixel - pixel_) / pose_.sigma_px;
        if (jacobians && jacobians[0])
            put(point->by_x, jacobians[0]);
        if (jacobians && jacobians[1])
            put(point->by_y, jacobians[1]);
        return true;
    }

private:
    void put(const Matrix2x6& derivative, double* jacobian) const {
        Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> j(jacobian);
        j << derivative / pose_.sigma_px, Eigen::Vector2d::Zero();
    }

    const Projector& projector_;
    const RegistrationPose& pose_;
    Eigen::Vector3d p_marker_;
    Eigen::Vector2d pixel_;
};

XY minimised(const Projector& projector, const Points& points, Poses poses, const XY& start,
             double huber_threshold) {
    std::array<double, 7> x{}, y{};
    LeftPerturbation::write(start.camera_from_base, x.data());
    LeftPerturbation::write(start.carriage_from_marker, y.data());
    ceres::Problem problem;
    problem.AddParameterBlock(x.data(), 7, new LeftPerturbation);
    problem.AddParameterBlock(y.data(), 7, new LeftPerturbation);
    for (const RegistrationPose& pose : poses)
        for (std::size_t i = 0; i < points.size(); ++i)
            problem.AddResidualBlock(new PointCost(projector, pose, points[i], pose.pixels[i]),
                                     new ceres::HuberLoss(huber_threshold), x.data(), y.data());
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_QR;
    options.num_threads = 1;
    options.max_num_iterations = 200;
    options.function_tolerance = 1e-15;
    options.gradient_tolerance = 1e-12;
    options.parameter_tolerance = 1e-13;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    if (summary.termination_type != ceres::CONVERGENCE)
        throw NumericalError("registration did not converge: " + summary.message);
    return {LeftPerturbation::read(x.data()), LeftPerturbation::read(y.data())};
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
        solution.xy = minimised(projector, points, poses, solution.xy, solution.huber_threshold);
    }
    return solution;
}

void summarize_residuals(const std::vector<double>& lengths, Poses poses, double threshold,
                         Registration& result) {
    const std::size_t points = lengths.size() / poses.size();
    double sum = 0.0;
    for (std::size_t i = 0; i < lengths.size(); ++i) {
        sum += std::pow(lengths[i] * poses[i / points].sigma_px, 2);
        result.down_weighted_points += lengths[i] > threshold ? 1 : 0;
    }
    result.residual_rms_px = std::sqrt(sum / (2.0 * static_cast<double>(lengths.size())));
}

// Where the marker is on average, base frame.
Eigen::Vector3d middle_of(Poses poses, const XY& xy) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const RegistrationPose& pose : poses)
        sum += pose.base_from_carriage * xy.carriage_from_marker.translation;
    return sum / static_cast<double>(poses.size());
}

RegistrationJacobian whole_jacobian(const Projector& projector, const Points& points, Poses poses,
                                    const XY& xy) {
    const Eigen::Index rows = 2 * std::ssize(points);
    RegistrationJacobian jacobian(rows * std::ssize(poses), 12);
    for (std::size_t i = 0; i < poses.size(); ++i)
        jacobian.middleRows(static_cast<Eigen::Index>(i) * rows, rows) =
            registration_jacobian(projector, points, xy.camera_from_base,
                                  poses[i].base_from_carriage, xy.carriage_from_marker) /
            poses[i].sigma_px;
    return jacobian;
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
    require_perspective(projector.camera(), "registration");
    require_usable(points_mm, given, nominal_carriage_from_marker);
    const StageMotion motion = required_motion(given);
    const std::vector<RegistrationPose> poses = with_transforms(given, motion.without_noise);
    const RobustSolution solution = robust_solution(projector, points_mm, poses, seed(poses));
    const RegistrationRank rank =
        registration_rank(whole_jacobian(projector, points_mm, poses, solution.xy), solution.xy);
    const Rigid& first = poses.front().base_from_carriage;
    const XY xy = nearest_to_prior(solution.xy, rank.freedoms, first, nominal_carriage_from_marker);

    Registration result{xy.camera_from_base, xy.carriage_from_marker};
    result.rank = rank.rank;
    result.condition_number = rank.condition_number;
    for (const Twist& twist : rank.freedoms)
        result.freedoms.push_back(gauge_freedom(twist, xy, first));
    const RegistrationJacobian jacobian = whole_jacobian(projector, points_mm, poses, xy);
    result.covariance = constrained_covariance(jacobian, result.freedoms);
    result.weak = weak_directions(jacobian, xy, rank.freedoms, middle_of(poses, xy), poses.size());
    result.motion = motion.words;
    summarize_residuals(residual_lengths(projector, points_mm, poses, xy), poses,
                        solution.huber_threshold, result);
    if (!result.covariance.allFinite() || !vector_from_rigid(result.camera_from_base).allFinite() ||
        !vector_from_rigid(result.carriage_from_marker).allFinite())
        throw NumericalError("registration gave a value that is not finite");
    return result;
}

}  // namespace etalon
