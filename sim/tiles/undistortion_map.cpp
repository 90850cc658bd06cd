#include "sim/tiles/undistortion_map.h"

#include <hwy/cache_control.h>

#include <Eigen/LU>

namespace etalon {
namespace {

constexpr double good_enough_px = 1e-4;  // of a cubic's error
// Of its estimate by differences of the nodes: beside a fold, where those say little, they are
// larger by far.
constexpr double surely_good_px = 0.1 * good_enough_px;
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

// The larger first: a matrix is a rotation with a stretch and a mirrored one.
Eigen::Vector2d singular_values(const Eigen::Matrix2d& m) {
    const double turned = std::hypot(m(0, 0) + m(1, 1), m(1, 0) - m(0, 1));
    const double mirrored = std::hypot(m(0, 0) - m(1, 1), m(1, 0) + m(0, 1));
    return {0.5 * (turned + mirrored), 0.5 * std::abs(turned - mirrored)};
}

// The union of `at(x, y)` over a rectangle that is not empty.
template <class At>
UndistortionMap::Group union_over(const cv::Rect& parts, const At& at) {
    UndistortionMap::Group whole = at(parts.x, parts.y);
    for_each_cell(parts, [&](int x, int y) {
        if (x != parts.x || y != parts.y)
            whole.unite(at(x, y));
    });
    return whole;
}

cv::Rect parts_of(int i, int j, int side) {
    return {i * side, j * side, side, side};
}

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

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
    const cv::Rect blocks = cells_of(tiles_, block_side);
    blocks_ = std::make_unique<CellTable<BlockSlot>>(blocks);
    levels_.emplace_back(blocks);
    make_blocks();
    while (std::max(levels_.back().rect.width, levels_.back().rect.height) > group_side) {
        const CellTable<Group>& below = levels_.back();
        CellTable<Group> level(cells_of(below.rect, group_side));
        for_each_cell(level.rect, [&](int i, int j) {
            level.at(i, j) = union_over(parts_of(i, j, group_side) & below.rect,
                                        [&](int x, int y) { return below.at(x, y); });
        });
        levels_.push_back(std::move(level));
    }
}

void UndistortionMap::Group::unite(const Group& other) {
    if (validity == Validity::none)
        bounds = other.bounds;
    else if (other.validity != Validity::none)
        bounds = {bounds.low.cwiseMin(other.bounds.low), bounds.high.cwiseMax(other.bounds.high)};
    if (validity != other.validity)
        validity = Validity::some;
    curvature = std::max(curvature, other.curvature);
    least_scale = std::min(least_scale, other.least_scale);
    largest_scale = std::max(largest_scale, other.largest_scale);
}

cv::Rect UndistortionMap::groups(int level) const {
    if (level >= block_level)
        return levels_[static_cast<std::size_t>(level - block_level)].rect;
    return level == 0 ? tiles_ : cells_of(tiles_, group_side);
}

// What a search asks first, from the corners of the blocks.
void UndistortionMap::make_blocks() {
    const cv::Rect blocks = blocks_->rect;
    CellTable<Eigen::Vector2d> rays(
        {blocks.x - 1, blocks.y - 1, blocks.width + 3, blocks.height + 3});
    for_each_cell(rays.rect, [&](int i, int j) {
        rays.at(i, j) = projector_.unproject(tile_corner_px(i * block_side, j * block_side))
                            .value_or(Eigen::Vector2d(nan, nan));
    });
    for_each_cell(blocks, [&](int i, int j) {
        const TilePolynomial cubic =
            polynomial_through([&](int row, int column) -> const Eigen::Vector2d& {
                return rays.at(i - 1 + column, j - 1 + row);
            });
        const auto surely = group_of_block(i, j, cubic);
        levels_.front().at(i, j) = surely ? *surely : block(i, j).whole;
    });
}

// Nothing where the cubic says too little. It errs most in the middle.
std::optional<UndistortionMap::Group> UndistortionMap::group_of_block(
    int i, int j, const TilePolynomial& cubic) const {
    constexpr double safety = 10.0, enough_px = 0.1 * block_side * tile_px;
    if (!cubic.x.allFinite() || !cubic.y.allFinite())
        return std::nullopt;
    double error = 0.0;
    for (const auto& [s, t] :
         {std::pair{0.0, 0.0}, {-0.27, -0.31}, {0.29, -0.23}, {-0.24, 0.26}, {0.28, 0.3}}) {
        const Eigen::Vector2d rough = at(cubic, s, t).x;
        const Eigen::Vector2d within(s + 0.5, t + 0.5);
        const auto exact = projector_.unproject(
            tile_corner_px(i * block_side, j * block_side) + block_side * tile_px * within, rough);
        if (!exact)
            return std::nullopt;
        error = std::max(error, (*exact - rough).norm());
    }
    const Box box = bounds_of(cubic);
    const Eigen::Vector2d margin = Eigen::Vector2d::Constant(safety * error);
    if (!(margin.x() * projector_.camera().intrinsics.fx < enough_px))
        return std::nullopt;
    return Group{Validity::all, {box.low - margin, box.high + margin}};
}

// Two threads may make the same block: one of the two is thrown away.
const UndistortionMap::Block& UndistortionMap::block(int i, int j) const {
    std::atomic<const Block*>& slot = blocks_->at(i, j).made;
    if (const Block* made = slot.load(std::memory_order_acquire))
        return *made;
    std::unique_ptr<const Block> fresh = make_block(i, j);
    const Block* other = nullptr;
    return slot.compare_exchange_strong(other, fresh.get(), std::memory_order_acq_rel)
               ? *fresh.release()
               : *other;
}

std::unique_ptr<const UndistortionMap::Block> UndistortionMap::make_block(int i, int j) const {
    auto block = std::make_unique<Block>();
    const cv::Rect tiles = parts_of(i, j, block_side) & tiles_;
    make_nodes(i, j, tiles, *block);
    for_each_cell(tiles, [&](int x, int y) {
        block->tiles[place_in<block_side>(x, y)] = make_tile(x, y, *block);
    });
    block->whole = union_over(cells_of(tiles, group_side), [&](int x, int y) {
        return block->groups[place_in<group_side>(x, y)] =
                   union_over(parts_of(x, y, group_side) & tiles, [&](int column, int row) {
                       return block->tiles[place_in<block_side>(column, row)];
                   });
    });
    return block;
}

// Each is found from its neighbours, by the parabola through three of them.
void UndistortionMap::make_nodes(int i, int j, const cv::Rect& tiles, Block& block) const {
    block.nodes.fill({nan, nan});
    for (int y = tiles.y - 1; y <= tiles.br().y + 1; ++y)
        for (int x = tiles.x - 1; x <= tiles.br().x + 1; ++x) {
            Eigen::Vector2d& node = block.nodes[static_cast<std::size_t>(
                (y - block_side * j + 1) * nodes_a_side + x - block_side * i + 1)];
            const auto continued = [&](std::ptrdiff_t stride) -> Eigen::Vector2d {
                const Eigen::Vector2d* last = &node - stride;
                return 3.0 * (last[0] - last[-stride]) + last[-2 * stride];
            };
            Eigen::Vector2d near(nan, nan);
            if (x >= tiles.x + 2)
                near = continued(1);
            else if (y >= tiles.y + 2)
                near = continued(nodes_a_side);
            const Eigen::Vector2d corner = tile_corner_px(x, y);
            if (const auto found = near.allFinite() ? projector_.unproject(corner, near)
                                                    : projector_.unproject(corner))
                node = *found;
        }
}

const Eigen::Vector2d& UndistortionMap::node(const Block& block, int i, int j, int row,
                                             int column) {
    const int x = (i & (block_side - 1)) + column, y = (j & (block_side - 1)) + row;
    return block.nodes[static_cast<std::size_t>(y * nodes_a_side + x)];
}

TilePolynomial UndistortionMap::through_nodes(const Block& block, int i, int j) {
    return polynomial_through([&](int row, int column) -> const Eigen::Vector2d& {
        return node(block, i, j, row, column);
    });
}

UndistortionMap::Tile UndistortionMap::make_tile(int i, int j, Block& block) const {
    int without_ray = 0;
    for (int n = 0; n < 16; ++n)
        without_ray += std::isnan(node(block, i, j, n / 4, n % 4).x());
    if (without_ray > 0)
        return without_ray == 16 ? Tile() : make_border_tile(i, j);
    const TilePolynomial cubic = through_nodes(block, i, j);
    Tile tile;
    tile.validity = Validity::all;
    tile.bounds = bounds_of(cubic);
    set_bend(block, i, j, tile);
    const double fx = projector_.camera().intrinsics.fx;
    if (bend_of_nodes(block, i, j) * fx < surely_good_px)
        return tile;
    // The cubic errs most in the middle. A wide-angle lens may bend too much for it.
    const Eigen::Vector2d corner = tile_corner_px(i, j);
    const auto error = error_at(cubic.centre, corner + Eigen::Vector2d::Constant(0.5 * tile_px));
    if (!error)
        return make_border_tile(i, j);
    if (*error * fx < good_enough_px)
        return tile;
    if (const auto own = cubic_within(corner, tile_px, cubic)) {
        tile.bounds = bounds_of(*own);
        tile.own_cubic = static_cast<int>(block.own_cubics.size());
        block.own_cubics.push_back(*own);
    } else {
        const Eigen::Vector2d margin =
            tile.bounds.half() + Eigen::Vector2d::Constant(10.0 * *error);
        tile.validity = Validity::some;
        tile.bounds = {tile.bounds.low - margin, tile.bounds.high + margin};
    }
    return tile;
}

// The error of the cubics through four nodes, in their middle: 3/128 of the fourth differences
// along the rows and the columns of nodes around the tile.
double UndistortionMap::bend_of_nodes(const Block& block, int i, int j) {
    const int column = (i & (block_side - 1)) + 1 - ((i & (block_side - 1)) == 0 ? 1 : 2);
    const int row = (j & (block_side - 1)) + 1 - ((j & (block_side - 1)) == 0 ? 1 : 2);
    const auto differences = [&](int x, int y, int stride) {
        const Eigen::Vector2d* n = &block.nodes[static_cast<std::size_t>(y * nodes_a_side + x)];
        const Eigen::Vector2d fourth =
            (n[0] + n[4 * stride]) - 4.0 * (n[stride] + n[3 * stride]) + 6.0 * n[2 * stride];
        return fourth.cwiseAbs().sum();
    };
    double sum = 0.0;  // no largest: it must not be a number where a node is none
    for (int n = 1; n <= 2; ++n)
        sum += differences(column, (j & (block_side - 1)) + n, 1) +
               differences((i & (block_side - 1)) + n, row, nodes_a_side);
    return 3.0 / 128.0 * sum;
}

// From differences of the nodes, which are a tile apart.
void UndistortionMap::set_bend(const Block& block, int i, int j, Group& tile) const {
    const auto n = [&](int row, int column) -> const Eigen::Vector2d& {
        return node(block, i, j, row, column);
    };
    const Eigen::Vector2d middle = n(1, 1) + n(1, 2) + n(2, 1) + n(2, 2);
    Eigen::Matrix2d derivative;
    derivative << n(1, 2) - n(1, 1), n(2, 1) - n(1, 1);
    Eigen::Matrix<double, 2, 3> bends;  // along s, along t, mixed
    bends << 0.25 * (n(1, 0) + n(1, 3) + n(2, 0) + n(2, 3) - middle),
        0.25 * (n(0, 1) + n(3, 1) + n(0, 2) + n(3, 2) - middle),
        n(2, 2) - n(2, 1) - n(1, 2) + n(1, 1);
    bends /= tile_px * tile_px;
    const Eigen::Matrix2d px_per_x = tile_px * derivative.inverse();
    const double largest = (px_per_x * bends).cwiseAbs().maxCoeff();
    tile.curvature = largest <= Bend::most ? largest : Bend::most;  // not a number beside a fold
    if (!px_per_x.allFinite())
        return;
    const Intrinsics& intrinsics = projector_.camera().intrinsics;
    const Eigen::Vector2d lengths = singular_values(px_per_x);
    tile.largest_scale = lengths[0] / std::max(intrinsics.fx, intrinsics.fy);
    tile.least_scale = lengths[1] / std::min(intrinsics.fx, intrinsics.fy);
}

void UndistortionMap::prefetch(int level, const cv::Rect& groups) const {
    for_each_cell(groups, [&](int i, int j) { hwy::Prefetch(&group(level, i, j)); });
}

UndistortionMap::Bend UndistortionMap::bend(int level, int i, int j) const {
    const Group& one = level == block_level ? block(i, j).whole : group(level, i, j);
    const bool has_scale = one.largest_scale > 0.0;
    return {one.curvature, one.validity == Validity::all, has_scale ? one.least_scale : 1.0,
            has_scale ? one.largest_scale : 1.0};
}

UndistortionMap::Bend UndistortionMap::bend(const cv::Rect& tiles) const {
    const cv::Rect within = cells_of(tiles & tiles_, group_side);
    Bend all;
    const auto include = [&](const Bend& one) {
        all.curvature = std::max(all.curvature, one.curvature);
        all.is_polynomial = all.is_polynomial && one.is_polynomial;
        all.least_scale = std::min(all.least_scale, one.least_scale);
        all.largest_scale = std::max(all.largest_scale, one.largest_scale);
    };
    for_each_cell(cells_of(within, group_side), [&](int x, int y) {
        const cv::Rect groups = parts_of(x, y, group_side), own = groups & within;
        if (own == groups)
            include(bend(block_level, x, y));
        else
            for_each_cell(own, [&](int i, int j) { include(bend(1, i, j)); });
    });
    return all;
}

// Distance of undistorted coordinates from those of a pixel, to first order; nothing where they
// have no pixel.
std::optional<double> UndistortionMap::error_at(const Eigen::Vector2d& rough,
                                                const Eigen::Vector2d& pixel) const {
    const auto there = projector_.project_with_jacobian(rough.homogeneous());
    if (!there)
        return std::nullopt;
    const Eigen::Matrix2d by_px = there->jacobian.leftCols<2>().inverse();
    return (by_px * (there->pixel - pixel)).norm();
}

// From points so dense that no ray lies farther from them than they reach: beside a fold rays
// spread like the square root of the distance from it. Half as dense where all have rays or none.
UndistortionMap::Tile UndistortionMap::make_border_tile(int i, int j) const {
    constexpr int n = 2 * tile_px, points = n + 1;
    Eigen::Vector2d low = Eigen::Vector2d::Constant(1e9), high = -low, last(0.0, 0.0);
    const auto include = [&](double x, double y) {
        const auto ray = projector_.unproject(
            tile_corner_px(i, j) + Eigen::Vector2d(x, y) * (tile_px / double(n)), last);
        if (ray) {
            last = *ray;
            low = low.cwiseMin(last);
            high = high.cwiseMax(last);
        }
        return ray.has_value();
    };
    CellTable<char> rays({0, 0, points, points});
    for_each_cell(rays.rect, [&](int x, int y) { rays.at(x, y) = include(x, y); });
    for_each_cell({0, 0, n, n}, [&](int x, int y) {
        const int of_corners =
            rays.at(x, y) + rays.at(x + 1, y) + rays.at(x, y + 1) + rays.at(x + 1, y + 1);
        if (of_corners == 0 || of_corners == 4)
            return;
        for (const auto& [right, down] :
             {std::pair{0.5, 0.0}, {0.0, 0.5}, {0.5, 0.5}, {1.0, 0.5}, {0.5, 1.0}})
            include(x + right, y + down);
    });
    if (low.x() > high.x())
        return {};
    const Intrinsics& intrinsics = projector_.camera().intrinsics;
    const Eigen::Vector2d pixel(1.0 / intrinsics.fx, 1.0 / intrinsics.fy);
    const Eigen::Vector2d margin = (high - low).cwiseMax(tile_px * pixel);
    Tile tile;
    tile.validity = Validity::some;
    tile.bounds = {low - margin, high + margin};
    tile.curvature = Bend::most;
    return tile;
}

TilePolynomial UndistortionMap::polynomial(int i, int j) const {
    const Block& block = block_of(i, j);
    const int own = block.tiles[place_in<block_side>(i, j)].own_cubic;
    return own >= 0 ? block.own_cubics[static_cast<std::size_t>(own)] : through_nodes(block, i, j);
}

// Its nodes are a third of its side apart. It errs most between the outer ones.
std::optional<TilePolynomial> UndistortionMap::cubic_within(const Eigen::Vector2d& corner_px,
                                                            double side_px,
                                                            const TilePolynomial& rough) const {
    std::array<Eigen::Vector2d, 16> nodes;
    for (int n = 0; n < 16; ++n) {
        const Eigen::Vector2d within = Eigen::Vector2d(n % 4, n / 4) / 3.0;
        const auto x = projector_.unproject(corner_px + within * side_px,
                                            at(rough, within.x() - 0.5, within.y() - 0.5).x);
        if (!x)
            return std::nullopt;
        nodes[static_cast<std::size_t>(n)] = *x;
    }
    const TilePolynomial cubic = polynomial_within(nodes);
    for (const double place : {-0.37, 0.0, 0.37}) {
        const Eigen::Vector2d of_cubic = at(cubic, place, place).x;
        const auto exact = projector_.unproject(
            corner_px + Eigen::Vector2d::Constant((0.5 + place) * side_px), of_cubic);
        const double error = exact ? (*exact - of_cubic).norm() : infinity;
        if (!(error * projector_.camera().intrinsics.fx < good_enough_px))
            return std::nullopt;
    }
    return cubic;
}

void UndistortionMap::prefetch_polynomial(int i, int j) const {
    const Block& block = block_of(i, j);
    for (int row = 0; row < 4; ++row) {
        hwy::Prefetch(&node(block, i, j, row, 0));
        hwy::Prefetch(&node(block, i, j, row, 3));
    }
}

std::optional<MappedPoint> UndistortionMap::exact(const Eigen::Vector2d& pixel,
                                                  const std::optional<MappedPoint>& near) const {
    const auto x = near ? projector_.unproject(pixel, near->x) : projector_.unproject(pixel);
    if (!x)
        return std::nullopt;
    return MappedPoint{*x, projector_.pixel_by_normalised(*x).inverse()};
}

void UndistortionMap::sample(int i, int j, int n,
                             std::vector<std::optional<MappedPoint>>& points) const {
    points.clear();
    std::optional<TilePolynomial> cubic;
    if (validity(i, j) == Validity::all)
        cubic = polynomial(i, j);
    std::optional<MappedPoint> last;
    for (int q = 0; q < n * n; ++q) {
        const Eigen::Vector2d within(q % n + 0.5, q / n + 0.5);
        points.push_back(cubic
                             ? at(*cubic, within.x() / n - 0.5, within.y() / n - 0.5)
                             : exact(tile_corner_px(i, j) + within * (tile_px / double(n)), last));
        if (points.back())
            last = points.back();
    }
}

}  // namespace etalon
