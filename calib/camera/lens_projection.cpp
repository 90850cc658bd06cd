#include "calib/camera/lens_projection.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

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

void check_coefficients(std::span<const double> coefficients) {
    constexpr double most = 1e12;
    for (const double value : coefficients)
        if (!(std::abs(value) <= most))
            throw NumericalError(fmt::format("no projection has a coefficient of {}", value));
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
    const Kind kind = projection.kind;
    if (projection.table) {
        const auto image = onto_plane_by_table(projection, ray.template cast<double>());
        if (!image)
            return std::nullopt;
        return BasicOnPlane<Scalar>{image->point.template cast<Scalar>(),
                                    image->by_ray.template cast<Scalar>()};
    }
    const Eigen::Matrix<Scalar, 2, 1> across = ray.template head<2>();
    const Scalar s = across.squaredNorm(), z = ray.z();
    if (!has_image(kind, a, b, s, z))
        return std::nullopt;
    const Scale<Scalar> scale = scale_of(kind, a, b, s, z);
    BasicOnPlane<Scalar> image;
    image.point = scale.g * across;
    image.by_ray.template leftCols<2>() = 2 * scale.by_s * across * across.transpose();
    image.by_ray.template leftCols<2>().diagonal().array() += scale.g;
    image.by_ray.col(2) = scale.by_z * across;
    image.by_a = scale.by_a * across;
    image.by_b = scale.by_b * across;
    if (!image.point.allFinite() || !image.by_ray.allFinite())
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

}  // namespace etalon
