#include <Eigen/Eigenvalues>

#include "calib/camera/lens_projection.h"
#include "core/optimize/root_search.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

struct Depth {
    double value, slope;  // Z for R = r, and its derivative
};
Depth depth_at(const LensTable& table, double r) {
    const double a2 = table.coefficients[0], a3 = table.coefficients[1], a4 = table.coefficients[2];
    return {1.0 + r * r * (a2 + r * (a3 + r * a4)), r * (2.0 * a2 + r * (3.0 * a3 + r * 4.0 * a4))};
}

// The radius whose ray has this R and Z: (r, depth) turns past (R, Z) there. Nothing beyond the
// limit.
std::optional<double> radius_of(const LensTable& table, double across, double z) {
    const auto past = [&](double r) {
        const Depth depth = depth_at(table, r);
        return ValueAndSlope{r * z - across * depth.value, z - across * depth.slope};
    };
    return rising_root(past, table.limit, z > 0.0 ? across / z : 1.0);
}

}  // namespace

LensProjection polynomial_projection(double a2, double a3, double a4, double shear) {
    auto table = std::make_shared<LensTable>();
    table->coefficients = {a2, a3, a4, shear};
    check_coefficients(table->coefficients);
    table->limit = first_positive_root({1.0, 0.0, -a2, -2.0 * a3, -3.0 * a4});
    return {.kind = Projection::polynomial, .table = std::move(table)};
}

// By the implicit function r(R, Z) of r Z = R f(r).
std::optional<OnPlane> polynomial_onto_plane(const LensTable& table, const Eigen::Vector3d& ray) {
    const double across = ray.head<2>().norm(), z = ray.z();
    const auto r =
        across > 0.0 ? radius_of(table, across / ray.norm(), z / ray.norm()) : std::optional(0.0);
    if (!r || !ray.allFinite() || (across == 0.0 && !(z > 0.0)))
        return std::nullopt;
    const Depth depth = depth_at(table, *r);
    const double change = z - across * depth.slope;
    const double by_across = depth.value / change, by_z = -*r / change;
    const double scale = across > 0.0 ? *r / across : by_across;
    const Eigen::Vector2d direction =
        across > 0.0 ? Eigen::Vector2d(ray.head<2>() / across) : Eigen::Vector2d::Zero();
    const Eigen::Matrix2d shear =
        (Eigen::Matrix2d() << 1.0, 0.0, table.coefficients[3], 1.0).finished();
    OnPlane image;
    image.point = shear * (scale * ray.head<2>());
    image.by_ray.leftCols<2>() = scale * Eigen::Matrix2d::Identity() +
                                 (by_across - scale) * direction * direction.transpose();
    image.by_ray.col(2) = by_z * direction;
    image.by_ray = shear * image.by_ray;
    if (!image.point.allFinite() || !image.by_ray.allFinite())
        return std::nullopt;
    return image;
}

std::optional<Eigen::Vector3d> polynomial_from_plane(const LensTable& table,
                                                     const Eigen::Vector2d& point) {
    const Eigen::Vector2d q(point.x(), point.y() - table.coefficients[3] * point.x());
    const double r = q.norm();
    if (!(r < table.limit))
        return std::nullopt;
    const Eigen::Vector3d ray(q.x(), q.y(), depth_at(table, r).value);
    if (!ray.allFinite())
        return std::nullopt;
    return ray.normalized();
}

}  // namespace etalon
