#include "calib/camera/lens_projection.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>  // homogeneous()

#include "calib/camera/valid_region.h"
#include "core/optimize/root_search.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using Kind = Projection;

constexpr ProjectionName names[] = {
    {Kind::perspective, "perspective", {"", ""}},
    {Kind::telecentric, "telecentric", {"", ""}},
    {Kind::equidistant, "equidistant", {"", ""}},
    {Kind::stereographic, "stereographic", {"", ""}},
    {Kind::field_of_view, "field_of_view", {"omega", ""}},
    {Kind::unified, "unified", {"xi", ""}},
    {Kind::extended_unified, "extended_unified", {"beta", "alpha"}},
    {Kind::double_sphere, "double_sphere", {"xi", "alpha"}},
    {Kind::polynomial, "polynomial", {"", ""}, {"a2", "a3", "a4", "shear"}},
    {Kind::cahvor, "cahvor", {"", ""}, {"alpha", "beta", "r0", "r1", "r2", "linearity"}},
    {Kind::splined_stereographic, "splined_stereographic", {"", ""}},
};

// g of the header and its derivatives; by_s is that with respect to s = X^2 + Y^2.
template <typename Real>
struct Scale {
    Real g, by_s, by_z, by_a = 0, by_b = 0;
};

// Of 1 / q.
template <typename Real>
Scale<Real> inverse_of(const Scale<Real>& q) {
    const Real g = 1 / q.g, slope = -g * g;
    return {g, slope * q.by_s, slope * q.by_z, slope * q.by_a, slope * q.by_b};
}

// theta / R. Near the axis its difference quotient cancels: there atan's series in t = s / z^2.
template <typename Real>
Scale<Real> angle_over_radius(Real s, Real z) {
    const Real by_z = -1.0 / (s + z * z);
    const Real t = s / (z * z);
    if (z > 0.0 && t < 1e-3) {
        Real g = 0, by_t = 0;
        for (int n = 6; n >= 1; --n) {
            const Real term = Real(n % 2 == 0 ? 1 : -1) / (2 * n + 1);
            by_t = n * term + t * by_t;
            g = t * (term + g);
        }
        return {(1.0 + g) / z, by_t / (z * z * z), by_z};
    }
    const Real g = std::atan2(std::sqrt(s), z) / std::sqrt(s);
    return {g, (-z * by_z - g) / (2.0 * s), by_z};
}

// 2 tan(a / 2) / a, 1 at 0.
template <typename Real>
Real tangent_over_angle(Real a) {
    return a < 1e-8 ? Real(1) : 2 * std::tan(a / 2) / a;
}

template <typename Real>
Scale<Real> field_of_view(Real a, Real s, Real z) {
    const Real stretch = tangent_over_angle(a), factor = stretch * a;  // 2 tan(a/2)
    const Scale angle = angle_over_radius(factor * factor * s, z);
    // (1 + factor^2 / 4 - stretch) / a, which cancels where a is small.
    const Real stretch_by_a = a < 0.02 ? a / 6.0 * (1.0 + a * a / 5.0 + 17 * a * a * a * a / 560)
                                       : (1.0 + 0.25 * factor * factor - stretch) / a;
    const Real factor_by_a = 1.0 + 0.25 * factor * factor;
    return {stretch * angle.g, stretch * factor * factor * angle.by_s, stretch * angle.by_z,
            stretch_by_a * angle.g + stretch * angle.by_s * 2.0 * factor * factor_by_a * s};
}

// Behind the camera the sum z + a d cancels.
template <typename Real>
Scale<Real> unified(Real a, Real s, Real z) {
    const Real d = std::sqrt(s + z * z);
    const Real sum = z > 0.0 ? z + a * d : (a * a * s + (a * a - 1.0) * z * z) / (a * d - z);
    return inverse_of<Real>({sum, 0.5 * a / d, 1.0 + a * z / d, d});
}

// 2 / (d + z); behind the camera d + z cancels and is s / (d - z).
template <typename Real>
Scale<Real> stereographic(Real s, Real z) {
    const Real d = std::sqrt(s + z * z);
    const Real sum = z > 0.0 ? d + z : s / (d - z);
    const Real g = 2.0 / sum;
    return {g, -g / sum / (2.0 * d), -g / d};
}

template <typename Real>
Scale<Real> extended_unified(Real a, Real b, Real s, Real z) {
    const Real d = std::sqrt(a * s + z * z);
    return inverse_of<Real>(
        {b * d + (1.0 - b) * z, 0.5 * a * b / d, b * z / d + 1.0 - b, 0.5 * b * s / d, d - z});
}

template <typename Real>
Scale<Real> double_sphere(Real a, Real b, Real s, Real z) {
    const Real first = std::sqrt(s + z * z), w = a * first + z;
    const Real second = std::sqrt(s + w * w);
    const Real by_w = b * w / second + 1.0 - b;
    return inverse_of<Real>({b * second + (1.0 - b) * w, 0.5 * b / second + by_w * 0.5 * a / first,
                             by_w * (a * z / first + 1.0), by_w * first, second - w});
}

template <typename Real>
Scale<Real> scale_of(Kind kind, Real a, Real b, Real s, Real z) {
    switch (kind) {
        case Kind::perspective:
            return {1.0 / z, 0.0, -1.0 / (z * z)};
        case Kind::telecentric:
            return {1.0, 0.0, 0.0};
        case Kind::equidistant:
            return angle_over_radius(s, z);
        case Kind::stereographic:
            return stereographic(s, z);
        case Kind::field_of_view:
            return field_of_view(a, s, z);
        case Kind::unified:
            return unified(a, s, z);
        case Kind::extended_unified:
            return extended_unified(a, b, s, z);
        case Kind::double_sphere:
            return double_sphere(a, b, s, z);
        default:
            return {};
    }
}

// The papers' w1: the cosine's bound of the outer sphere.
template <typename Real>
Real outer_bound(Real alpha) {
    return alpha <= 0.5 ? alpha / (1 - alpha) : (1 - alpha) / alpha;
}

template <typename Real>
bool has_image(Kind kind, Real a, Real b, Real s, Real z) {
    const Real d = std::sqrt(s + z * z);
    switch (kind) {
        case Kind::perspective:
        case Kind::telecentric:
            return z > 0.0;
        case Kind::equidistant:
        case Kind::stereographic:
            return s > 0.0 || z > 0.0;
        case Kind::field_of_view:
            return z > 0.0 || (s > 0.0 && a > 0.0);
        case Kind::unified:
            return z > -d * (a > 1 ? 1 / a : a);
        case Kind::extended_unified:
            return z > -outer_bound(b) * std::sqrt(a * s + z * z);
        case Kind::double_sphere: {
            const Real w = a * d + z;
            return w > -outer_bound(b) * std::sqrt(s + w * w);
        }
        default:
            return false;
    }
}

template <typename Real>
std::optional<BasicOnPlane<Real>> onto_plane_by_scale(Kind kind, Real a, Real b,
                                                      const Eigen::Matrix<Real, 3, 1>& ray) {
    const Eigen::Matrix<Real, 2, 1> across = ray.template head<2>();
    const Real s = across.squaredNorm(), z = ray.z();
    if (!has_image(kind, a, b, s, z))
        return std::nullopt;
    const Scale<Real> scale = scale_of(kind, a, b, s, z);
    BasicOnPlane<Real> image;
    image.point = scale.g * across;
    image.by_ray.template leftCols<2>() = 2 * scale.by_s * across * across.transpose();
    image.by_ray.template leftCols<2>().diagonal().array() += scale.g;
    image.by_ray.col(2) = scale.by_z * across;
    image.by_a = scale.by_a * across;
    image.by_b = scale.by_b * across;
    return image;
}

using Found = std::optional<Eigen::Vector3d>;

Found at_angle(const Eigen::Vector2d& m, double angle, double sine_over_radius) {
    if (!(angle < std::numbers::pi))
        return std::nullopt;
    return Eigen::Vector3d(sine_over_radius * m.x(), sine_over_radius * m.y(), std::cos(angle));
}

double sinc(double x) {
    return x < 1e-8 ? 1.0 : std::sin(x) / x;
}

// Of the unit sphere about (0, 0, -a), seen from there: Mei's lift of (x, y, z).
Found lifted(double a, double x, double y, double z) {
    const double squared = x * x + y * y;
    const double root = z * z + (1.0 - a * a) * squared;
    if (!(root >= 0.0))
        return std::nullopt;
    const double k = (z * a + std::sqrt(root)) / (z * z + squared);
    return Eigen::Vector3d(k * x, k * y, k * z - a);
}

// The depth at which alpha and beta put the point of the plane.
std::optional<double> plane_depth(double alpha, double beta, double squared) {
    const double root = 1.0 - (2.0 * alpha - 1.0) * beta * squared;
    if (!(root >= 0.0))
        return std::nullopt;
    return (1.0 - alpha * alpha * beta * squared) / (alpha * std::sqrt(root) + 1.0 - alpha);
}

Found ray_at(const LensProjection& p, const Eigen::Vector2d& m) {
    const double radius = m.norm();
    switch (p.kind) {
        case Kind::perspective:
        case Kind::telecentric:
            return Eigen::Vector3d(m.x(), m.y(), 1.0);
        case Kind::equidistant:
            return at_angle(m, radius, sinc(radius));
        case Kind::stereographic: {
            const double t = 0.25 * radius * radius;
            return Eigen::Vector3d(m.x(), m.y(), 1.0 - t) / (1.0 + t);
        }
        case Kind::field_of_view: {
            const double angle = p.a * radius;
            const Found ray = at_angle(m, angle, sinc(angle) / tangent_over_angle(p.a));
            return ray ? Found(ray->normalized()) : ray;
        }
        case Kind::unified:
            return lifted(p.a, m.x(), m.y(), 1.0);
        case Kind::extended_unified: {
            const auto depth = plane_depth(p.b, p.a, radius * radius);
            return depth ? Found(Eigen::Vector3d(m.x(), m.y(), *depth).normalized()) : std::nullopt;
        }
        case Kind::double_sphere: {
            const auto depth = plane_depth(p.b, 1.0, radius * radius);
            return depth ? lifted(p.a, m.x(), m.y(), *depth) : std::nullopt;
        }
        default:
            return std::nullopt;
    }
}

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

std::optional<OnPlane> cahvor_onto_plane(const LensTable& table, const Eigen::Vector3d& ray) {
    const auto seen = ray.allFinite() ? bent(Cahvor(table), ray / ray.norm()) : std::nullopt;
    if (!seen || !(seen->ray.z() > 0.0))
        return std::nullopt;
    OnPlane image;
    image.point = seen->ray.head<2>() / seen->ray.z();
    image.by_ray = (seen->by_ray.topRows<2>() - image.point * seen->by_ray.bottomRows<1>()) /
                   (seen->ray.z() * ray.norm());
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

const LensProjection stereographic_plane{.kind = Projection::stereographic};

// Weights of the control points around a place, and their derivatives; how many control points of
// the first one precede the place's nearest.
struct Weights {
    int first;
    std::array<double, 4> value, slope;
};

// `x` counts control points. Uniform B-splines: de Boor, "A Practical Guide to Splines", 1978.
Weights cubic_weights_at(double x, int count) {
    const int left = std::clamp(static_cast<int>(x), 1, count - 3);
    const double t = x - left, tt = t * t, ttt = tt * t, s = 1.0 - t;
    return {left - 1,
            {s * s * s / 6.0, (3.0 * ttt - 6.0 * tt + 4.0) / 6.0,
             (-3.0 * ttt + 3.0 * tt + 3.0 * t + 1.0) / 6.0, ttt / 6.0},
            {-0.5 * s * s, 1.5 * tt - 2.0 * t, -1.5 * tt + t + 0.5, 0.5 * tt}};
}
Weights quadratic_weights_at(double x, int count) {
    const int nearest = std::clamp(static_cast<int>(x + 0.5), 1, count - 2);
    const double t = x - nearest;
    return {nearest - 1,
            {0.5 * (t - 0.5) * (t - 0.5), 0.75 - t * t, 0.5 * (t + 0.5) * (t + 0.5), 0.0},
            {t - 0.5, -2.0 * t, t + 0.5, 0.0}};
}

// Control points per unit of the plane.
double density(const LensTable& table) {
    return (table.columns - table.order) /
           (4.0 * std::tan(table.field_of_view_deg * (std::numbers::pi / 720.0)));
}

bool in_field(const LensTable& table, const Eigen::Vector2d& u) {
    const double half = 0.5 / density(table);
    return std::abs(u.x()) <= half * (table.columns - table.order) &&
           std::abs(u.y()) <= half * (table.rows - table.order);
}

bool in_region(const LensTable& table, const Eigen::Vector2d& u) {
    return in_field(table, u) &&
           (table.folds.empty() || u.norm() < radius_in_direction(table.folds, u));
}

struct Splined {
    Eigen::Vector2d point;
    Eigen::Matrix2d jacobian;
    bool is_regular() const { return jacobian.determinant() > 0.0 && point.allFinite(); }
};

// Of a point in the field.
Splined splined(const LensTable& table, const Eigen::Vector2d& u) {
    const double per_unit = density(table);
    const Eigen::Vector2d middle(0.5 * (table.columns - 1), 0.5 * (table.rows - 1));
    const Eigen::Vector2d place = per_unit * u + middle;
    const auto weights_at = table.order == 3 ? cubic_weights_at : quadratic_weights_at;
    const Weights wx = weights_at(place.x(), table.columns);
    const Weights wy = weights_at(place.y(), table.rows);
    Splined result{u, Eigen::Matrix2d::Identity()};
    for (int row = 0; row <= table.order; ++row) {
        const double* at =
            table.coefficients.data() + 2 * ((wy.first + row) * table.columns + wx.first);
        Eigen::Vector2d value = Eigen::Vector2d::Zero(), slope = Eigen::Vector2d::Zero();
        for (std::size_t col = 0; col <= static_cast<std::size_t>(table.order); ++col, at += 2) {
            value += wx.value[col] * Eigen::Vector2d(at[0], at[1]);
            slope += wx.slope[col] * Eigen::Vector2d(at[0], at[1]);
        }
        const auto i = static_cast<std::size_t>(row);
        result.point += wy.value[i] * value;
        result.jacobian.col(0) += per_unit * wy.value[i] * slope;
        result.jacobian.col(1) += per_unit * wy.slope[i] * value;
    }
    return result;
}

// The last radius before the first fold, or before the field ends, which is then no fold.
double fold_radius(const LensTable& table, const Eigen::Vector2d& direction) {
    const double step = 1.0 / (16.0 * density(table));
    double before = 0.0;
    for (int i = 1; in_field(table, i * step * direction); ++i) {
        const double here = i * step;
        if (!splined(table, here * direction).is_regular()) {
            double fold = here;
            for (int halving = 0; halving < 60; ++halving) {
                const double middle = 0.5 * (before + fold);
                (splined(table, middle * direction).is_regular() ? before : fold) = middle;
            }
            return before;
        }
        before = here;
    }
    return std::numeric_limits<double>::infinity();
}

std::vector<double> folds_of(const LensTable& table) {
    constexpr int directions = 256;
    std::vector<double> folds;
    for (int i = 0; i < directions; ++i) {
        const double angle = 2.0 * std::numbers::pi * i / directions;
        folds.push_back(fold_radius(table, {std::cos(angle), std::sin(angle)}));
    }
    const bool any =
        std::any_of(folds.begin(), folds.end(), [](double r) { return std::isfinite(r); });
    return any ? folds : std::vector<double>{};
}

std::optional<Eigen::Vector2d> unsplined(const LensTable& table, const Eigen::Vector2d& point) {
    const auto map = [&](const Eigen::Vector2d& u) { return splined(table, u); };
    const auto contains = [&](const Eigen::Vector2d& u) { return in_region(table, u); };
    const double scale = point.norm() + 1e-3;
    if (contains(point))
        if (const auto u = damped_newton(map, contains, point, point, scale))
            return u;
    // From the axis on, whose own image need not be on the axis.
    constexpr int steps = 32;
    const Eigen::Vector2d middle = map(Eigen::Vector2d::Zero()).point;
    std::optional<Eigen::Vector2d> u = Eigen::Vector2d::Zero();
    for (int i = 1; i <= steps && u; ++i)
        u = damped_newton(map, contains, middle + (point - middle) * (double(i) / steps), *u,
                          scale);
    return u;
}

std::optional<OnPlane> splined_onto_plane(const LensTable& table, const Eigen::Vector3d& ray) {
    auto image = onto_plane(stereographic_plane, ray);
    if (!image || !in_region(table, image->point))
        return std::nullopt;
    const Splined at = splined(table, image->point);
    if (!at.is_regular())
        return std::nullopt;
    image->point = at.point;
    image->by_ray = at.jacobian * image->by_ray;
    return image;
}

std::optional<Eigen::Vector3d> splined_from_plane(const LensTable& table,
                                                  const Eigen::Vector2d& point) {
    const auto u = point.allFinite() ? unsplined(table, point) : std::nullopt;
    return u ? from_plane(stereographic_plane, *u) : std::nullopt;
}

void check_coefficients(std::span<const double> coefficients) {
    constexpr double most = 1e12;
    for (const double value : coefficients)
        if (!(std::abs(value) <= most))
            throw NumericalError(fmt::format("no projection has a coefficient of {}", value));
}

std::optional<OnPlane> onto_plane_by_table(const LensProjection& p, const Eigen::Vector3d& ray) {
    return p.kind == Kind::polynomial ? polynomial_onto_plane(*p.table, ray)
           : p.kind == Kind::cahvor   ? cahvor_onto_plane(*p.table, ray)
                                      : splined_onto_plane(*p.table, ray);
}

Found from_plane_by_table(const LensProjection& p, const Eigen::Vector2d& point) {
    return p.kind == Kind::polynomial ? polynomial_from_plane(*p.table, point)
           : p.kind == Kind::cahvor   ? cahvor_from_plane(*p.table, point)
                                      : splined_from_plane(*p.table, point);
}

}  // namespace

bool LensProjection::operator==(const LensProjection& other) const {
    const bool same_table =
        table == other.table || (table && other.table && *table == *other.table);
    return kind == other.kind && a == other.a && b == other.b && same_table;
}

std::span<const ProjectionName> projection_names() {
    return names;
}

const ProjectionName& name_of(Projection kind) {
    return names[static_cast<std::size_t>(kind)];
}

double scale_on_axis(const LensProjection& projection) {
    const auto on_axis = onto_plane(projection, Eigen::Vector3d::UnitZ());
    if (!on_axis)
        throw NumericalError("the projection has no image of its axis");
    return on_axis->by_ray(0, 0);
}

bool has_table(Projection kind) {
    return kind == Kind::polynomial || kind == Kind::cahvor || kind == Kind::splined_stereographic;
}

std::vector<std::pair<const char*, double>> named_parameters(const LensProjection& projection) {
    std::vector<std::pair<const char*, double>> named;
    const ProjectionName& known = name_of(projection.kind);
    for (std::size_t i = 0; i < known.parameters.size(); ++i)
        if (*known.parameters[i])
            named.emplace_back(known.parameters[i], i == 0 ? projection.a : projection.b);
    for (std::size_t i = 0; i < known.coefficients.size() && known.coefficients[i]; ++i)
        named.emplace_back(known.coefficients[i], projection.table->coefficients[i]);
    return named;
}

double plane_limit(const LensProjection& p) {
    constexpr double none = std::numeric_limits<double>::infinity();
    const auto of_alpha = [&](double beta) {
        return p.b > 0.5 ? 1.0 / std::sqrt((2.0 * p.b - 1.0) * beta) : none;
    };
    switch (p.kind) {
        case Kind::equidistant:
            return std::numbers::pi;
        case Kind::field_of_view:
            return p.a > 0.0 ? std::numbers::pi / p.a : none;
        case Kind::unified:
            return p.a > 1.0 ? 1.0 / std::sqrt(p.a * p.a - 1.0) : none;
        case Kind::extended_unified:
            return of_alpha(p.a);
        case Kind::double_sphere:
            return of_alpha(1.0);
        default:
            return none;
    }
}

bool is_possible(const LensProjection& p) {
    if (!std::isfinite(p.a) || !std::isfinite(p.b) || has_table(p.kind) != bool(p.table))
        return false;
    const auto is_share = [](double x) { return x >= 0.0 && x <= 1.0; };
    switch (p.kind) {
        case Kind::field_of_view:
            return p.a >= 0.0 && p.a < std::numbers::pi;
        case Kind::unified:
            return p.a >= 0.0;
        case Kind::extended_unified:
            return p.a > 0.0 && is_share(p.b);
        case Kind::double_sphere:
            return p.a > -1.0 && p.a <= 1.0 && is_share(p.b);
        default:
            return true;
    }
}

void require_possible(const LensProjection& p) {
    if (!is_possible(p))
        throw NumericalError(fmt::format("no {} projection has the parameters {} and {}",
                                         name_of(p.kind).name, p.a, p.b));
}

template <typename Scalar>
std::optional<BasicOnPlane<Scalar>> onto_plane(const LensProjection& projection, Scalar a, Scalar b,
                                               const Eigen::Matrix<Scalar, 3, 1>& ray) {
    std::optional<BasicOnPlane<Scalar>> image;
    if (projection.table) {
        if (const auto at = onto_plane_by_table(projection, ray.template cast<double>()))
            image = {at->point.template cast<Scalar>(), at->by_ray.template cast<Scalar>()};
    } else {
        image = onto_plane_by_scale(projection.kind, a, b, ray);
    }
    if (!image || !image->point.allFinite() || !image->by_ray.allFinite())
        return std::nullopt;
    return image;
}
template std::optional<BasicOnPlane<double>> onto_plane(const LensProjection&, double, double,
                                                        const Eigen::Vector3d&);
template std::optional<BasicOnPlane<long double>> onto_plane(
    const LensProjection&, long double, long double, const Eigen::Matrix<long double, 3, 1>&);

std::optional<OnPlane> onto_plane(const LensProjection& projection, const Eigen::Vector3d& ray) {
    return onto_plane(projection, projection.a, projection.b, ray);
}

std::optional<Eigen::Vector3d> from_plane(const LensProjection& projection,
                                          const Eigen::Vector2d& point) {
    if (projection.table)
        return from_plane_by_table(projection, point);
    const auto ray = ray_at(projection, point);
    if (!ray || !ray->allFinite() ||
        !has_image(projection.kind, projection.a, projection.b, ray->head<2>().squaredNorm(),
                   ray->z()))
        return std::nullopt;
    return ray;
}

LensProjection polynomial_projection(double a2, double a3, double a4, double shear) {
    auto table = std::make_shared<LensTable>();
    table->coefficients = {a2, a3, a4, shear};
    check_coefficients(table->coefficients);
    table->limit = first_positive_root({1.0, 0.0, -a2, -2.0 * a3, -3.0 * a4});
    return {.kind = Projection::polynomial, .table = std::move(table)};
}

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

LensProjection splined_projection(int order, int columns, int rows, double field_of_view_deg,
                                  std::vector<double> control_points) {
    const auto is_side = [](int side) { return side >= 4 && side <= 1000; };
    if ((order != 2 && order != 3) || !is_side(columns) || !is_side(rows) ||
        !(field_of_view_deg > 0.0 && field_of_view_deg < 360.0))
        throw NumericalError(fmt::format(
            "no splined projection has order {}, {} x {} control points and a field of view of {} "
            "degrees",
            order, columns, rows, field_of_view_deg));
    if (control_points.size() != 2 * static_cast<std::size_t>(columns) * rows)
        throw NumericalError(fmt::format("{} x {} control points have {} numbers, not {}", columns,
                                         rows, 2 * columns * rows, control_points.size()));
    check_coefficients(control_points);
    auto table = std::make_shared<LensTable>();
    table->coefficients = std::move(control_points);
    table->order = order;
    table->columns = columns;
    table->rows = rows;
    table->field_of_view_deg = field_of_view_deg;
    if (!splined(*table, Eigen::Vector2d::Zero()).is_regular())
        throw NumericalError("the splined projection folds over on its axis");
    table->folds = folds_of(*table);
    return {.kind = Projection::splined_stereographic, .table = std::move(table)};
}

}  // namespace etalon
