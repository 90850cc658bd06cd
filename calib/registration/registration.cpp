#include "calib/registration/registration.h"

#include <ceres/sized_cost_function.h>
#include <fmt/format.h>

#include <Eigen/Dense>
#include <numbers>

#include "calib/registration/registration_solver.h"
#include "core/errors.h"

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
            projector_, p_marker_, {read_parameters(parameters[0]), read_parameters(parameters[1])},
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
    return minimised(start, huber_threshold, [&](const AddResidual& add) {
        for (const RegistrationPose& pose : poses)
            for (std::size_t i = 0; i < points.size(); ++i)
                add(new PointCost(projector, pose, points[i], pose.pixels[i]));
    });
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

}  // namespace etalon
