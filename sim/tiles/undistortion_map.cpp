#include "sim/tiles/undistortion_map.h"

#include <hwy/cache_control.h>

#include <Eigen/LU>
#include <Eigen/SVD>
#include <array>
#include <cmath>

#include "sim/tiles/tile_map.h"

namespace etalon {
namespace {

// Lagrange's cubic basis on the nodes -1, 0, 1, 2, and its derivative.
Eigen::Vector4d cubic_weights(double t) {
    return {-t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2, -(t + 1) * t * (t - 2) / 2,
            (t + 1) * t * (t - 1) / 6};
}
Eigen::Vector4d cubic_slopes(double t) {
    return {-(3 * t * t - 6 * t + 2) / 6, (3 * t * t - 4 * t - 1) / 2, -(3 * t * t - 2 * t - 2) / 2,
            (3 * t * t - 1) / 6};
}

// From values at the nodes -1, 0, 1, 2 to the Bezier control values of the same cubic on [0, 1]:
// its ends, and a third of its slope there inwards.
const Eigen::Matrix4d& bezier_from_nodes() {
    static const Eigen::Matrix4d matrix = [] {
        Eigen::Matrix4d m = Eigen::Matrix4d::Zero();
        m(0, 1) = m(3, 2) = 1.0;
        m.row(1) = m.row(0) + cubic_slopes(0).transpose() / 3.0;
        m.row(2) = m.row(3) - cubic_slopes(1).transpose() / 3.0;
        return m;
    }();
    return matrix;
}

constexpr double good_enough_px = 1e-4;  // of a cubic's error
constexpr double infinity = std::numeric_limits<double>::infinity();

// The coefficients of the cubic whose values at -1.5, -0.5, 0.5 and 1.5 are these, element by
// element.
template <class Values>
std::array<Values, 4> cubic_through(const std::array<Values, 4>& values) {
    const Values outer = values[3] + values[0], inner = values[2] + values[1];
    const Values far = values[3] - values[0], near = values[2] - values[1];
    return {(9.0 * inner - outer) / 16.0, (27.0 * near - far) / 24.0, (outer - inner) / 4.0,
            (far - 3.0 * near) / 6.0};
}

// Both coordinates at once, through the values node(row, column) at -1.5, -0.5, 0.5 and 1.5: first
// along s in each row of nodes, then along t.
template <class Node>
TilePolynomial polynomial_through(const Node& node) {
    using ByPower = Eigen::Matrix<double, 2, 4>;  // x and y by the power of s
    std::array<ByPower, 4> rows;
    for (int row = 0; row < 4; ++row) {
        const auto of_row = cubic_through<Eigen::Vector2d>(
            {node(row, 0), node(row, 1), node(row, 2), node(row, 3)});
        for (int power = 0; power < 4; ++power)
            rows[static_cast<std::size_t>(row)].col(power) =
                of_row[static_cast<std::size_t>(power)];
    }
    const std::array<ByPower, 4> by_power = cubic_through(rows);
    TilePolynomial result;
    for (int power = 0; power < 4; ++power) {
        const ByPower& both = by_power[static_cast<std::size_t>(power)];
        result.x.row(power) = both.row(0);
        result.y.row(power) = both.row(1);
    }
    result.centre = {result.x(0, 0), result.y(0, 0)};
    result.x(0, 0) = result.y(0, 0) = 0.0;
    return result;
}

// Through points a third of a tile apart, row by row, the outer ones at its corners.
TilePolynomial polynomial_within(const std::array<Eigen::Vector2d, 16>& nodes) {
    TilePolynomial cubic = polynomial_through([&](int row, int column) -> const Eigen::Vector2d& {
        return nodes[static_cast<std::size_t>(4 * row + column)];
    });
    constexpr std::array power{1.0, 3.0, 9.0, 27.0, 81.0, 243.0, 729.0};
    for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column) {
            cubic.x(row, column) *= power[static_cast<std::size_t>(row + column)];
            cubic.y(row, column) *= power[static_cast<std::size_t>(row + column)];
        }
    return cubic;
}

// The derivative is by the pixel.
MappedPoint at(const TilePolynomial& cubic, double s, double t) {
    const Eigen::Vector4d ws(1, s, s * s, s * s * s), ds(0, 1, 2 * s, 3 * s * s);
    const Eigen::Vector4d wt(1, t, t * t, t * t * t), dt(0, 1, 2 * t, 3 * t * t);
    MappedPoint point;
    point.x = cubic.centre + Eigen::Vector2d(wt.dot(cubic.x * ws), wt.dot(cubic.y * ws));
    point.jacobian << wt.dot(cubic.x * ds), dt.dot(cubic.x * ws), wt.dot(cubic.y * ds),
        dt.dot(cubic.y * ws);
    point.jacobian /= tile_px;
    return point;
}

// Around the Bezier control points: values of the blossom at the ends -0.5 and 0.5.
Box bounds_of(const TilePolynomial& cubic) {
    static const Eigen::Matrix4d control = [] {
        Eigen::Matrix4d m;
        m << 1, -1 / 2., 1 / 4., -1 / 8., 1, -1 / 6., -1 / 12., 1 / 8., 1, 1 / 6., -1 / 12.,
            -1 / 8., 1, 1 / 2., 1 / 4., 1 / 8.;
        return m;
    }();
    const Eigen::Matrix4d x = control * cubic.x * control.transpose();
    const Eigen::Matrix4d y = control * cubic.y * control.transpose();
    return {cubic.centre + Eigen::Vector2d(x.minCoeff(), y.minCoeff()),
            cubic.centre + Eigen::Vector2d(x.maxCoeff(), y.maxCoeff())};
}

}  // namespace

TilePolynomial turned(const TilePolynomial& polynomial, const Eigen::Matrix3d& turn) {
    std::array<Eigen::Vector2d, 16> nodes;
    for (int n = 0; n < 16; ++n)
        nodes[static_cast<std::size_t>(n)] =
            (turn * at(polynomial, n % 4 / 3.0 - 0.5, n / 4 / 3.0 - 0.5).x.homogeneous())
                .hnormalized();
    return polynomial_within(nodes);
}

UndistortionMap::UndistortionMap(const Projector& projector, int margin_px)
    : UndistortionMap(projector, grown({0, 0, projector.camera().width, projector.camera().height},
                                       margin_px, margin_px)) {}

UndistortionMap::UndistortionMap(const Projector& projector, const cv::Rect& pixels)
    : projector_(projector), tiles_(cells_of(pixels, tile_px)) {
    make_nodes();
    Level tiles{tiles_, {}};
    tiles.table.reserve(static_cast<std::size_t>(tiles_.area()));
    for (int j = tiles_.y; j < tiles_.br().y; ++j)
        for (int i = tiles_.x; i < tiles_.br().x; ++i)
            tiles.table.push_back(make_tile(i, j));
    groups_.push_back(std::move(tiles));
    while (std::max(groups_.back().rect.width, groups_.back().rect.height) > group_side)
        groups_.push_back(group_up(groups_.back()));
}

UndistortionMap::Tile UndistortionMap::united(const Tile& a, const Tile& b) {
    Tile both = a.validity == Validity::none ? b : a;
    if (a.validity != Validity::none && b.validity != Validity::none)
        both.bounds = {a.bounds.low.cwiseMin(b.bounds.low), a.bounds.high.cwiseMax(b.bounds.high)};
    both.validity = a.validity == b.validity ? a.validity : Validity::some;
    both.curvature = std::max(a.curvature, b.curvature);
    both.least_scale = std::min(a.least_scale, b.least_scale);
    both.largest_scale = std::max(a.largest_scale, b.largest_scale);
    return both;
}

UndistortionMap::Level UndistortionMap::group_up(const Level& below) {
    const int left = floor_div(below.rect.x, group_side), top = floor_div(below.rect.y, group_side);
    const int right = floor_div(below.rect.br().x - 1, group_side);
    const int bottom = floor_div(below.rect.br().y - 1, group_side);
    Level level{{left, top, right - left + 1, bottom - top + 1}, {}};
    for (int j = top; j <= bottom; ++j)
        for (int i = left; i <= right; ++i) {
            const cv::Rect children =
                cv::Rect(i * group_side, j * group_side, group_side, group_side) & below.rect;
            std::optional<Tile> sum;
            for (int y = children.y; y < children.br().y; ++y)
                for (int x = children.x; x < children.br().x; ++x)
                    sum = sum ? united(*sum, below.at(x, y)) : below.at(x, y);
            level.table.push_back(*sum);
        }
    return level;
}

void UndistortionMap::make_nodes() {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    nodes_.reserve(static_cast<std::size_t>(tiles_.width + 3) *
                   static_cast<std::size_t>(tiles_.height + 3));
    for (int j = tiles_.y - 1; j <= tiles_.br().y + 1; ++j)
        for (int i = tiles_.x - 1; i <= tiles_.br().x + 1; ++i) {
            const auto x = projector_.unproject(tile_corner_px(i, j));
            nodes_.push_back(x ? *x : Eigen::Vector2d(nan, nan));
        }
}

UndistortionMap::Nodes UndistortionMap::nodes(int i, int j, int axis) const {
    Nodes values;
    for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column)
            values(row, column) = node(i - 1 + column, j - 1 + row)[axis];
    return values;
}

UndistortionMap::Tile UndistortionMap::make_tile(int i, int j) {
    const Nodes x = nodes(i, j, 0), y = nodes(i, j, 1);
    const Box nowhere{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
    if (x.array().isNaN().all())
        return {Validity::none, nowhere};
    if (x.array().isNaN().any())
        return make_border_tile(i, j);
    const Eigen::Matrix4d& b = bezier_from_nodes();
    const Eigen::Matrix4d control_x = b * x * b.transpose(), control_y = b * y * b.transpose();
    const Box bounds{{control_x.minCoeff(), control_y.minCoeff()},
                     {control_x.maxCoeff(), control_y.maxCoeff()}};
    // The cubic errs most in the middle. A wide-angle lens may bend too much for it.
    const double error = error_in_the_middle(i, j, x, y);
    if (!std::isfinite(error))
        return make_border_tile(i, j);
    Tile tile{Validity::all, bounds};
    const bool is_good = error * projector_.camera().intrinsics.fx < good_enough_px;
    if (const auto own = is_good ? std::nullopt : own_cubic(i, j)) {
        tile.bounds = bounds_of(*own);
        tile.own_cubic = static_cast<int>(own_cubics_.size());
        own_cubics_.push_back(*own);
    } else if (!is_good) {
        const Eigen::Vector2d margin = bounds.half() + Eigen::Vector2d::Constant(10.0 * error);
        tile = {Validity::some, {bounds.low - margin, bounds.high + margin}};
    }
    set_bend(x, y, tile);
    return tile;
}

// From differences of the nodes, which are a tile apart.
void UndistortionMap::set_bend(const Nodes& x, const Nodes& y, Tile& tile) const {
    const auto second = [](const Nodes& n) -> Eigen::Vector3d {
        const double along_s = n.row(1).sum() + n.row(2).sum() - 2.0 * n.block(1, 1, 2, 2).sum();
        const double along_t = n.col(1).sum() + n.col(2).sum() - 2.0 * n.block(1, 1, 2, 2).sum();
        const double mixed = n(2, 2) - n(2, 1) - n(1, 2) + n(1, 1);
        return Eigen::Vector3d(0.25 * along_s, 0.25 * along_t, mixed) / (tile_px * tile_px);
    };
    Eigen::Matrix2d derivative;
    derivative << x(1, 2) - x(1, 1), x(2, 1) - x(1, 1), y(1, 2) - y(1, 1), y(2, 1) - y(1, 1);
    Eigen::Matrix<double, 2, 3> bends;
    bends << second(x).transpose(), second(y).transpose();
    const Eigen::Matrix2d px_per_x = tile_px * derivative.inverse();
    const double largest = (px_per_x * bends).cwiseAbs().maxCoeff();
    tile.curvature = largest <= Bend::most ? largest : Bend::most;  // not a number beside a fold
    if (!px_per_x.allFinite())
        return;
    const Intrinsics& intrinsics = projector_.camera().intrinsics;
    const Eigen::Vector2d lengths = Eigen::JacobiSVD<Eigen::Matrix2d>(px_per_x).singularValues();
    tile.largest_scale = lengths[0] / std::max(intrinsics.fx, intrinsics.fy);
    tile.least_scale = lengths[1] / std::min(intrinsics.fx, intrinsics.fy);
}

void UndistortionMap::prefetch(int level, const cv::Rect& groups) const {
    for (int j = groups.y; j < groups.br().y; ++j)
        for (int i = groups.x; i < groups.br().x; ++i)
            hwy::Prefetch(&group(level, i, j));
}

UndistortionMap::Bend UndistortionMap::bend(int level, int i, int j) const {
    const Tile& tile = group(level, i, j);
    const bool has_scale = tile.largest_scale > 0.0;
    return {tile.curvature, tile.validity == Validity::all, has_scale ? tile.least_scale : 1.0,
            has_scale ? tile.largest_scale : 1.0};
}

UndistortionMap::Bend UndistortionMap::bend(const cv::Rect& tiles) const {
    const int level = std::min(1, levels() - 1), side = level == 0 ? 1 : group_side;
    const cv::Rect within = cells_of(tiles & tiles_, side);
    Bend all;
    for (int j = within.y; j < within.br().y; ++j)
        for (int i = within.x; i < within.br().x; ++i) {
            const Bend one = bend(level, i, j);
            all.curvature = std::max(all.curvature, one.curvature);
            all.is_polynomial = all.is_polynomial && one.is_polynomial;
            all.least_scale = std::min(all.least_scale, one.least_scale);
            all.largest_scale = std::max(all.largest_scale, one.largest_scale);
        }
    return all;
}

// Distance of the polynomial from Newton's inverse at a tile's centre, in undistorted coordinates;
// infinite where there is no inverse.
double UndistortionMap::error_in_the_middle(int i, int j, const Nodes& x, const Nodes& y) const {
    const auto exact =
        projector_.unproject(tile_corner_px(i, j) + Eigen::Vector2d::Constant(0.5 * tile_px));
    if (!exact)
        return std::numeric_limits<double>::infinity();
    const Eigen::Vector4d w = cubic_weights(0.5);
    return (*exact - Eigen::Vector2d(w.dot(x * w), w.dot(y * w))).norm();
}

// From points so dense that no ray lies farther from them than they reach: beside a fold rays
// spread like the square root of the distance from it.
UndistortionMap::Tile UndistortionMap::make_border_tile(int i, int j) const {
    constexpr int n = 4 * tile_px;
    Eigen::Vector2d low = Eigen::Vector2d::Constant(1e9), high = -low;
    for (int q = 0; q < (n + 1) * (n + 1); ++q) {
        const Eigen::Vector2d within(q % (n + 1), q / (n + 1));
        if (const auto x = projector_.unproject(tile_corner_px(i, j) + within / 4.0)) {
            low = low.cwiseMin(*x);
            high = high.cwiseMax(*x);
        }
    }
    if (low.x() > high.x())
        return {Validity::none, {Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()}, 0.0};
    const Intrinsics& intrinsics = projector_.camera().intrinsics;
    const Eigen::Vector2d pixel(1.0 / intrinsics.fx, 1.0 / intrinsics.fy);
    const Eigen::Vector2d margin = (high - low).cwiseMax(tile_px * pixel);
    return {Validity::some, {low - margin, high + margin}, Bend::most};
}

TilePolynomial UndistortionMap::polynomial(int i, int j) const {
    if (const int own = tile(i, j).own_cubic; own >= 0)
        return own_cubics_[static_cast<std::size_t>(own)];
    return polynomial_through([&](int row, int column) -> const Eigen::Vector2d& {
        return node(i - 1 + column, j - 1 + row);
    });
}

// Its nodes are a third of a tile apart. It errs most between the outer ones.
std::optional<TilePolynomial> UndistortionMap::own_cubic(int i, int j) const {
    std::array<Eigen::Vector2d, 16> nodes;
    for (int n = 0; n < 16; ++n) {
        const Eigen::Vector2d within(n % 4, n / 4);
        const auto x = projector_.unproject(tile_corner_px(i, j) + within * (tile_px / 3.0));
        if (!x)
            return std::nullopt;
        nodes[static_cast<std::size_t>(n)] = *x;
    }
    const TilePolynomial cubic = polynomial_within(nodes);
    for (const double place : {-0.37, 0.0, 0.37}) {
        const auto exact = projector_.unproject(tile_corner_px(i, j) +
                                                Eigen::Vector2d::Constant((0.5 + place) * tile_px));
        const double error = exact ? (*exact - at(cubic, place, place).x).norm() : infinity;
        if (!(error * projector_.camera().intrinsics.fx < good_enough_px))
            return std::nullopt;
    }
    return cubic;
}

void UndistortionMap::prefetch_polynomial(int i, int j) const {
    for (int row = -1; row <= 2; ++row) {
        hwy::Prefetch(&node(i - 1, j + row));
        hwy::Prefetch(&node(i + 2, j + row));
    }
}

std::optional<MappedPoint> UndistortionMap::exact(const Eigen::Vector2d& pixel) const {
    const auto x = projector_.unproject(pixel);
    if (!x)
        return std::nullopt;
    return MappedPoint{*x, projector_.pixel_by_normalised(*x).inverse()};
}

void UndistortionMap::sample(int i, int j, int n,
                             std::vector<std::optional<MappedPoint>>& points) const {
    points.clear();
    points.reserve(static_cast<std::size_t>(n * n));
    if (validity(i, j) != Validity::all) {
        for (int q = 0; q < n * n; ++q) {
            const Eigen::Vector2d within(q % n + 0.5, q / n + 0.5);
            points.push_back(exact(tile_corner_px(i, j) + within * (tile_px / double(n))));
        }
        return;
    }
    if (const int own = tile(i, j).own_cubic; own >= 0) {
        for (int q = 0; q < n * n; ++q)
            points.push_back(at(own_cubics_[static_cast<std::size_t>(own)], (q % n + 0.5) / n - 0.5,
                                (q / n + 0.5) / n - 0.5));
        return;
    }
    const Nodes x = nodes(i, j, 0), y = nodes(i, j, 1);
    for (int row = 0; row < n; ++row) {
        const double t = (row + 0.5) / n;
        const Eigen::Vector4d wt = cubic_weights(t), dt = cubic_slopes(t) / tile_px;
        const Eigen::Vector4d x_row = x.transpose() * wt, y_row = y.transpose() * wt;
        const Eigen::Vector4d x_slope = x.transpose() * dt, y_slope = y.transpose() * dt;
        for (int column = 0; column < n; ++column) {
            const double s = (column + 0.5) / n;
            const Eigen::Vector4d ws = cubic_weights(s), ds = cubic_slopes(s) / tile_px;
            MappedPoint point;
            point.x << ws.dot(x_row), ws.dot(y_row);
            point.jacobian << ds.dot(x_row), ws.dot(x_slope), ds.dot(y_row), ws.dot(y_slope);
            points.push_back(point);
        }
    }
}

}  // namespace etalon
