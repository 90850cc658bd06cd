#include <Eigen/Geometry>  // homogeneous()

#include "calib/camera/lens_projection.h"
#include "core/optimize/root_search.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

struct Cahvor {
    explicit Cahvor(const LensTable& table)
        : r0(table.coefficients[2]),
          r1(table.coefficients[3]),
          r2(table.coefficients[4]),
          linearity(table.coefficients[5]),
          limit(table.limit) {
        const double alpha = table.coefficients[0], beta = table.coefficients[1];
        axis << std::sin(alpha) * std::cos(beta), std::sin(beta), std::cos(alpha) * std::cos(beta);
    }

    // c of the angle to the axis, and its derivative; less than nothing where there is none.
    ValueAndSlope bend(double angle) const {
        const double turned = linearity * angle;
        if (linearity == 0.0)
            return {angle, 1.0};
        if (!(std::abs(turned) < std::numbers::pi / 2))
            return {-1.0, 0.0};
        const double cosine = std::cos(turned);
        return linearity > 0.0
                   ? ValueAndSlope{std::tan(turned) / linearity, 1.0 / (cosine * cosine)}
                   : ValueAndSlope{std::sin(turned) / linearity, cosine};
    }
    double angle_of(double c) const {
        return linearity == 0.0  ? c
               : linearity > 0.0 ? std::atan(linearity * c) / linearity
                                 : std::asin(linearity * c) / linearity;
    }
    // t' of c.
    ValueAndSlope tangent(double c) const {
        const double cc = c * c;
        return {c * (1.0 + r0 + cc * (r1 + cc * r2)), 1.0 + r0 + cc * (3.0 * r1 + cc * 5.0 * r2)};
    }

    Eigen::Vector3d axis;
    double r0, r1, r2, linearity, limit;
};

// The bent ray and its derivative by the ray.
struct Bent {
    Eigen::Vector3d ray;
    Eigen::Matrix3d by_ray;
};
std::optional<Bent> bent(const Cahvor& lens, const Eigen::Vector3d& p) {
    const double along = p.dot(lens.axis);
    const Eigen::Vector3d aside = p - along * lens.axis;
    const double across = aside.norm(), squared = along * along + across * across;
    const ValueAndSlope c = lens.bend(std::atan2(across, along));
    if (!(c.value >= 0.0 && c.value < lens.limit) || !(squared > 0.0))
        return std::nullopt;
    const ValueAndSlope t = lens.tangent(c.value);
    const double scale = across > 0.0 ? t.value / across : t.slope / along;
    const Eigen::Vector3d direction =
        across > 0.0 ? Eigen::Vector3d(aside / across) : Eigen::Vector3d::Zero();
    const Eigen::Vector3d slope =
        t.slope * c.slope * (along * direction - across * lens.axis) / squared;
    return Bent{lens.axis + scale * aside,
                scale * (Eigen::Matrix3d::Identity() - lens.axis * lens.axis.transpose()) +
                    direction * (slope - scale * direction).transpose()};
}

}  // namespace

LensProjection cahvor_projection(double alpha, double beta, double r0, double r1, double r2,
                                 double linearity) {
    auto table = std::make_shared<LensTable>();
    table->coefficients = {alpha, beta, r0, r1, r2, linearity};
    check_coefficients(table->coefficients);
    if (!(std::cos(alpha) * std::cos(beta) > 0.0))
        throw NumericalError(fmt::format(
            "the axis of a CAHVOR lens must point forward: alpha {}, beta {}", alpha, beta));
    if (!(r0 > -1.0) || std::abs(linearity) > 1.0)
        throw NumericalError(fmt::format(
            "no CAHVOR lens has r0 {} and linearity {}: above -1, and -1 to 1", r0, linearity));
    table->limit = first_positive_root({1.0 + r0, 0.0, 3.0 * r1, 0.0, 5.0 * r2});
    const double widest = Cahvor(*table).bend(std::numbers::pi).value;  // c of all directions
    if (widest > 0.0)
        table->limit = std::min(table->limit, widest);
    else if (linearity < 0.0)
        table->limit = std::min(table->limit, -1.0 / linearity);
    return {.kind = Projection::cahvor, .table = std::move(table)};
}

std::optional<OnPlane> cahvor_onto_plane(const LensTable& table, const Eigen::Vector3d& ray) {
    const auto seen = ray.allFinite() ? bent(Cahvor(table), ray / ray.norm()) : std::nullopt;
    if (!seen || !(seen->ray.z() > 0.0))
        return std::nullopt;
    OnPlane image;
    image.point = seen->ray.head<2>() / seen->ray.z();
    image.by_ray = (seen->by_ray.topRows<2>() - image.point * seen->by_ray.bottomRows<1>()) /
                   (seen->ray.z() * ray.norm());
    if (!image.point.allFinite() || !image.by_ray.allFinite())
        return std::nullopt;
    return image;
}

std::optional<Eigen::Vector3d> cahvor_from_plane(const LensTable& table,
                                                 const Eigen::Vector2d& point) {
    const Cahvor lens(table);
    const Eigen::Vector3d seen = point.homogeneous();
    const double along = seen.dot(lens.axis);
    const Eigen::Vector3d aside = seen - along * lens.axis;
    const double across = aside.norm();
    if (!(along > 0.0) || !std::isfinite(across))
        return std::nullopt;
    if (across == 0.0)
        return lens.axis;
    const double target = across / along;
    const auto past = [&](double c) {
        const ValueAndSlope t = lens.tangent(c);
        return ValueAndSlope{t.value - target, t.slope};
    };
    const auto c = rising_root(past, lens.limit, target / (1.0 + lens.r0));
    if (!c)
        return std::nullopt;
    const double angle = lens.angle_of(*c);
    return Eigen::Vector3d(std::cos(angle) * lens.axis + (std::sin(angle) / across) * aside);
}

}  // namespace etalon
