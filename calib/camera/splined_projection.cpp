#include "calib/camera/lens_projection.h"
#include "calib/camera/valid_region.h"
#include "core/optimize/root_search.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

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

}  // namespace

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

}  // namespace etalon
