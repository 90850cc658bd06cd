#include "calib/camera/projector.h"

#include <fmt/format.h>

#include <Eigen/Geometry>  // homogeneous()

#include "core/geometry/rigid.h"
#include "core/optimize/root_search.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// Refuses before any member is computed from what is not a number.
const CameraModel& checked(const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    if (!(i.fx > 0.0) || !(i.fy > 0.0) || !std::isfinite(i.fx) || !std::isfinite(i.fy) ||
        !std::isfinite(i.cx) || !std::isfinite(i.cy) || !std::isfinite(i.skew))
        throw NumericalError(fmt::format("no camera has fx {}, fy {}, cx {}, cy {}, skew {}", i.fx,
                                         i.fy, i.cx, i.cy, i.skew));
    for (const double coefficient : camera.distortion.coefficients())
        if (!std::isfinite(coefficient))
            throw NumericalError("a distortion coefficient is not finite");
    const bool is_tilted = camera.distortion.tau_x != 0.0 || camera.distortion.tau_y != 0.0;
    if (camera.projection.kind != Projection::perspective && is_tilted)
        throw NumericalError(fmt::format("tau_x and tau_y belong to a perspective camera, not {}",
                                         name_of(camera.projection.kind).name));
    require_possible(camera.projection);
    return camera;
}

// The skew as a map of the plane, so that only cameras that have one spend time on it.
Eigen::Matrix3d shear(const Intrinsics& intrinsics) {
    Eigen::Matrix3d map = Eigen::Matrix3d::Identity();
    map(0, 1) = intrinsics.skew / intrinsics.fx;
    return map;
}

// The two flat projections, which rendering lives on, without the checks of onto_plane().
std::optional<OnPlane> projected(const LensProjection& projection, const Eigen::Matrix3d& turn,
                                 const Eigen::Vector3d& p) {
    if (!projection.is_flat()) {
        auto plane = onto_plane(projection, turn.transpose() * p);
        if (plane)
            plane->by_ray *= turn.transpose();
        return plane;
    }
    if (!(p.z() > 0.0))
        return std::nullopt;
    OnPlane result{p.head<2>()};
    result.by_ray << 1, 0, 0, 0, 1, 0;
    if (projection.kind == Projection::perspective) {
        result.point /= p.z();
        result.by_ray.col(2) = -result.point;
        result.by_ray /= p.z();
    }
    return result;
}

// Normalised, within the angle at which they still say enough.
std::optional<Eigen::Vector2d> in_front(const std::optional<Eigen::Vector3d>& ray) {
    if (!ray || !(ray->z() * wide_limit > ray->head<2>().norm()))
        return std::nullopt;
    return ray->hnormalized();
}

}  // namespace

Projector::Projector(const CameraModel& camera)
    : Projector(camera, ValidRegion(checked(camera).distortion, plane_limit(camera.projection))) {}

Projector::Projector(const CameraModel& camera, const Projector& like)
    : Projector(camera, like.region_) {}

Projector::Projector(const CameraModel& camera, ValidRegion region)
    : camera_(checked(camera)),
      has_distortion_(!camera.distortion.is_zero() || camera.intrinsics.skew != 0.0),
      has_tilt_(camera.distortion.tau_x != 0.0 || camera.distortion.tau_y != 0.0 ||
                camera.intrinsics.skew != 0.0),
      tilt_(shear(camera.intrinsics) *
            tilt_matrix(camera.distortion.tau_x, camera.distortion.tau_y)),
      untilt_(tilt_.inverse()),
      pixel_size_(1.0 / std::min(camera.intrinsics.fx, camera.intrinsics.fy)),
      region_(std::move(region)) {}

Projector Projector::turned(const Eigen::Quaterniond& turn) const {
    Projector result = *this;
    result.turn_ = turn.toRotationMatrix() * turn_;
    return result;
}

std::optional<Distorted> Projector::distorted(const Eigen::Vector2d& undistorted) const {
    if (!region_.contains(undistorted))
        return std::nullopt;
    Distorted result = distort_before_tilt(camera_.distortion, undistorted);
    if (has_tilt_)
        result = apply_tilt(tilt_, result);
    if (!result.is_regular())
        return std::nullopt;
    return result;
}

// Where a projection without a table ends, the region does.
bool Projector::has_ray(const Eigen::Vector2d& undistorted) const {
    return !camera_.projection.table || from_plane(camera_.projection, undistorted);
}

// solve() stays within the region and on this side of the distortion's fold; the tilt has its own.
bool Projector::is_accepted(const Eigen::Vector2d& solution) const {
    return !has_tilt_ || distorted(solution);
}

bool Projector::is_valid(const Eigen::Vector2d& undistorted) const {
    return distorted(undistorted).has_value() && has_ray(undistorted);
}

std::optional<Projected> Projector::project_with_jacobian(const Eigen::Vector3d& p_camera) const {
    const auto plane = projected(camera_.projection, turn_, p_camera);
    const auto d = plane ? distorted(plane->point) : std::nullopt;
    if (!d)
        return std::nullopt;
    const Intrinsics& i = camera_.intrinsics;
    Projected result;
    result.pixel << i.fx * d->point.x() + i.cx, i.fy * d->point.y() + i.cy;
    if (!result.pixel.allFinite())
        return std::nullopt;
    result.jacobian = Eigen::Vector2d(i.fx, i.fy).asDiagonal() * (d->jacobian * plane->by_ray);
    return result;
}

std::optional<Eigen::Vector2d> Projector::project(const Eigen::Vector3d& p_camera) const {
    const auto projected = project_with_jacobian(p_camera);
    if (!projected)
        return std::nullopt;
    return projected->pixel;
}

// The tilt is undone in closed form; nothing behind its horizon.
std::optional<Eigen::Vector2d> Projector::untilted(const Eigen::Vector2d& distorted) const {
    const Eigen::Vector3d h = untilt_ * distorted.homogeneous();
    if (!(h.z() > 0.0))
        return std::nullopt;
    return h.head<2>() / h.z();
}

std::optional<Eigen::Vector2d> Projector::solve(const Eigen::Vector2d& target,
                                                const Eigen::Vector2d& start) const {
    return damped_newton(
        [&](const Eigen::Vector2d& x) { return distort_before_tilt(camera_.distortion, x); },
        [&](const Eigen::Vector2d& x) { return region_.contains(x); }, target, start,
        target.norm() + pixel_size_);
}

// Follows the preimage while the target moves out from the axis: slow, but started near the
// solution at every step.
std::optional<Eigen::Vector2d> Projector::solve_along_ray(const Eigen::Vector2d& target) const {
    constexpr int steps = 32;
    std::optional<Eigen::Vector2d> x = Eigen::Vector2d::Zero();
    for (int i = 1; i <= steps && x; ++i)
        x = solve(target * (static_cast<double>(i) / steps), *x);
    return x;
}

std::optional<Eigen::Vector2d> Projector::undistorted(const Eigen::Vector2d& pixel) const {
    const auto point = on_plane(pixel, nullptr);
    return point && has_ray(*point) ? point : std::nullopt;
}

std::optional<Eigen::Vector2d> Projector::on_plane(const Eigen::Vector2d& pixel,
                                                   const Eigen::Vector2d* near) const {
    const Intrinsics& i = camera_.intrinsics;
    const Eigen::Vector2d target((pixel.x() - i.cx) / i.fx, (pixel.y() - i.cy) / i.fy);
    if (!target.allFinite())
        return std::nullopt;
    if (!has_distortion_)
        return region_.contains(target) ? std::optional(target) : std::nullopt;
    const auto before_tilt = has_tilt_ ? untilted(target) : target;
    if (!before_tilt || !(before_tilt->norm() <= region_.image_radius()))
        return std::nullopt;
    if (near != nullptr && region_.contains(*near))
        if (const auto x = solve(*before_tilt, *near); x && is_accepted(*x))
            return x;
    // A barrel's preimage lies outside its image and Newton climbs there; a start beyond the border
    // is drawn in.
    const double border = region_.border(*before_tilt);
    const double radius = before_tilt->norm();
    const Eigen::Vector2d start =
        radius < border ? *before_tilt : Eigen::Vector2d(*before_tilt * (0.9 * border / radius));
    auto x = solve(*before_tilt, start);
    if (!x)
        x = solve_along_ray(*before_tilt);
    if (!x || !is_accepted(*x))
        return std::nullopt;
    return x;
}

std::optional<Eigen::Vector3d> Projector::ray(const Eigen::Vector2d& pixel) const {
    return ray_of(on_plane(pixel, nullptr));
}

std::optional<Eigen::Vector3d> Projector::ray_of(
    const std::optional<Eigen::Vector2d>& point) const {
    auto ray = point ? from_plane(camera_.projection, *point) : std::nullopt;
    if (ray && !camera_.projection.is_flat())
        *ray = turn_ * *ray;
    return ray;
}

double Projector::border(const Eigen::Vector2d& direction) const {
    constexpr double farthest = 1e3;  // of a projection that does not end at a circle
    const double of_region = region_.border(direction);
    const Eigen::Vector2d along = direction.normalized();
    double within = 0.0, beyond = std::min(of_region, farthest);
    if (!camera_.projection.table || is_valid(beyond * along))
        return of_region;
    for (int i = 0; i < 50; ++i) {
        const double middle = 0.5 * (within + beyond);
        (is_valid(middle * along) ? within : beyond) = middle;
    }
    return within;
}

std::optional<Eigen::Vector2d> Projector::unproject(const Eigen::Vector2d& pixel) const {
    return camera_.projection.is_flat() ? undistorted(pixel) : in_front(ray(pixel));
}

std::optional<Eigen::Vector2d> Projector::unproject(const Eigen::Vector2d& pixel,
                                                    const Eigen::Vector2d& near) const {
    if (camera_.projection.is_flat())
        return on_plane(pixel, &near);
    const auto plane = projected(camera_.projection, turn_, near.homogeneous());
    return in_front(ray_of(on_plane(pixel, plane ? &plane->point : nullptr)));
}

Eigen::Matrix2d Projector::pixel_by_normalised(const Eigen::Vector2d& normalised) const {
    const Eigen::Matrix2d focal = camera_.intrinsics.pixel_by_plane();
    if (camera_.projection.is_flat())
        return focal * distort(camera_.distortion, normalised).jacobian;
    const auto plane = projected(camera_.projection, turn_, normalised.homogeneous());
    return focal * distort(camera_.distortion, plane->point).jacobian * plane->by_ray.leftCols<2>();
}

double depth_mm(const LensProjection& projection, const Eigen::Vector3d& p_camera) {
    return projection.is_flat() ? p_camera.z() : p_camera.norm();
}

Eigen::Quaterniond rotation_to_mean_direction(const std::vector<Eigen::Vector3d>& rays) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& ray : rays)
        mean += ray;
    return rotation_between(mean, Eigen::Vector3d::UnitZ());
}

VisibleProjection seen_across(const Eigen::Quaterniond& turn,
                              const std::vector<Eigen::Vector3d>& rays) {
    constexpr double least_cosine = 0.17;  // of 80 degrees
    VisibleProjection seen;
    for (std::size_t i = 0; i < rays.size(); ++i) {
        const Eigen::Vector3d ray = turn * rays[i];
        if (!(ray.z() > least_cosine))
            continue;
        seen.kept.push_back(i);
        seen.points.push_back(ray.hnormalized());
    }
    return seen;
}

}  // namespace etalon
