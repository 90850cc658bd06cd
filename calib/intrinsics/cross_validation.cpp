#include "calib/intrinsics/cross_validation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calib/camera/projector.h"
#include "calib/intrinsics/calibration_covariance.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

struct Half {
    CameraModel camera;
    std::size_t views = 0;
    Eigen::MatrixXd formal, robust;
};

Half calibrated_half(std::span<const CalibrationView> views, std::size_t first, cv::Size image_size,
                     const CalibrationModel& model, const CameraFit& all) {
    std::vector<CalibrationView> chosen;
    CameraStart start{all.camera, {}};
    for (std::size_t i = first; i < views.size(); i += 2) {
        chosen.push_back(views[i]);
        start.camera_from_target.push_back(all.camera_from_target[i]);
    }
    const CameraFit fit = fit_camera(chosen, image_size, model, {.start = start});
    const auto equations = view_equations(chosen, fit, model);
    return {fit.camera, chosen.size(), formal_covariance(equations, model, fit.variance),
            cluster_robust_covariance(equations, model)};
}

// The rays that the second camera sees too.
struct Seen {
    ImageRays rays;
    Eigen::VectorXd differences, deviations;  // two rows, one row for each
};

Seen seen_by_second(const ImageRays& rays, const Projector& second, const Rigid& motion,
                    const Eigen::VectorXd& deviations) {
    Seen seen;
    const auto most = static_cast<Eigen::Index>(rays.pixels.size());
    seen.differences.resize(2 * most);
    seen.deviations.resize(most);
    Eigen::Index count = 0;
    for (std::size_t i = 0; i < rays.pixels.size(); ++i) {
        const auto pixel = second.project(motion * rays.rays[i]);
        if (!pixel)
            continue;
        seen.rays.pixels.push_back(rays.pixels[i]);
        seen.rays.rays.push_back(rays.rays[i]);
        seen.differences.segment<2>(2 * count) = *pixel - rays.pixels[i];
        seen.deviations[count++] = deviations[static_cast<Eigen::Index>(i)];
    }
    if (count < 3)
        throw NumericalError("two calibrations of one camera have no rays in common");
    seen.differences.conservativeResize(2 * count);
    seen.deviations.conservativeResize(count);
    return seen;
}

// Of the rays, which of a telecentric camera have Z = 1 mm: a turn of theirs about x or y is a
// shift, which need not be small.
Rigid motion_of_rays(const Eigen::Vector3d& turn, Projection projection) {
    if (projection != Projection::telecentric)
        return {rotation_from_vector(turn), Eigen::Vector3d::Zero()};
    return {rotation_from_vector({0.0, 0.0, turn.z()}), {turn.y(), -turn.x(), 0.0}};
}

// Mean over the rays of the squared length that displacements of this covariance have.
double mean_square(const Eigen::MatrixXd& moved, const Eigen::MatrixXd& covariance) {
    return (moved * covariance).cwiseProduct(moved).sum() /
           (0.5 * static_cast<double>(moved.rows()));
}

}  // namespace

// Gauss-Newton; the rotation is small and the problem nearly linear.
ProjectionDifference projection_difference(const CameraModel& second, const ImageRays& rays,
                                           const Eigen::VectorXd& deviations) {
    const Projector projector(second);
    Rigid motion;
    for (int iteration = 0; iteration < 5; ++iteration) {
        const Seen seen = seen_by_second(rays, projector, motion, deviations);
        const Eigen::Vector3d step =
            -best_rotation(seen.differences, rotation_jacobian(second, seen.rays), seen.deviations);
        motion = motion_of_rays(step, second.projection.kind) * motion;
    }
    const Seen seen = seen_by_second(rays, projector, motion, deviations);
    ProjectionDifference difference{seen.rays.pixels, {}};
    for (Eigen::Index i = 0; i < seen.differences.size(); i += 2)
        difference.differences_px.emplace_back(seen.differences.segment<2>(i));
    return difference;
}

CrossValidation cross_validate(std::span<const CalibrationView> views, cv::Size image_size,
                               const CalibrationModel& model, const CameraFit& fit) {
    if (views.size() < min_cross_validation_views)
        throw NumericalError(fmt::format("{} views, {} are needed for two halves", views.size(),
                                         min_cross_validation_views));
    const Half first = calibrated_half(views, 0, image_size, model, fit);
    const Half second = calibrated_half(views, 1, image_size, model, fit);
    const Eigen::MatrixXd formal = first.formal + second.formal;
    const ImageRays rays = rays_among(image_rays(first.camera), all_pixels(views));
    const Eigen::MatrixXd moved = parameter_jacobian(first.camera, rays, model);
    const Eigen::VectorXd deviations = ray_deviations(moved, formal);
    ProjectionDifference difference = projection_difference(second.camera, rays, deviations);

    CrossValidation result{{first.views, second.views},
                           std::move(difference.pixels),
                           std::move(difference.differences_px)};
    double squares = 0.0;
    for (const Eigen::Vector2d& each : result.differences_px) {
        squares += each.squaredNorm();
        result.worst_px = std::max(result.worst_px, each.norm());
    }
    result.rms_px = std::sqrt(squares / static_cast<double>(result.differences_px.size()));

    const Eigen::MatrixXd rotated =
        less_best_rotation(moved, rotation_jacobian(first.camera, rays), deviations);
    result.expected_formal_px = std::sqrt(mean_square(rotated, formal));
    result.expected_robust_px = std::sqrt(mean_square(rotated, first.robust + second.robust));
    return result;
}

}  // namespace etalon
