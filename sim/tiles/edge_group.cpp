#include "sim/tiles/edge_group.h"

#include <Eigen/LU>
#include <cmath>

namespace etalon {
namespace {

// Coefficients of the cubic through values at -1/2, -1/4, 1/4 and 1/2, element by element.
template <class Values>
std::array<Values, 4> cubic_through_corners(const std::array<Values, 4>& v) {
    const Values far = 0.5 * (v[3] + v[0]), near = 0.5 * (v[2] + v[1]);
    const Values odd_far = v[3] - v[0], odd_near = 2.0 * (v[2] - v[1]);
    const Values square = (16.0 / 3.0) * (far - near);
    const Values cube = (16.0 / 3.0) * (odd_far - odd_near);
    return {near - square / 16.0, odd_far - 0.25 * cube, square, cube};
}

// D / |w| in units of the aperture's radius: all of the line on the lens that its segment's area
// depends on, for the points of a perspective or telecentric camera.
class EdgeOffset {
public:
    EdgeOffset(const MarkerView& view, const OneEdge& edge)
        : line_(view.h().row(edge.axis) - edge.index * view.h().row(2)),
          defocus_(view.depth_row()) {
        const Aperture& aperture = view.aperture();
        defocus_ -= Eigen::Vector3d(aperture.focus_slope.x(), aperture.focus_slope.y(),
                                    aperture.focus_on_axis);
        const Eigen::Vector2d turn = view.turn({0.0, 0.0});
        slope_x_ = aperture.radius_mm * (line_.x() * defocus_ - turn.x() * line_);
        slope_y_ = aperture.radius_mm * (line_.y() * defocus_ - turn.y() * line_);
    }

    double at(const Eigen::Vector2d& x) const {
        const auto form = [&](const Eigen::Vector3d& f) {
            return f.x() * x.x() + f.y() * x.y() + f.z();
        };
        const double wx = form(slope_x_), wy = form(slope_y_);
        return form(line_) / std::sqrt(wx * wx + wy * wy);
    }

private:
    Eigen::Vector3d line_, defocus_, slope_x_, slope_y_;
};

// By the place in the group, from -0.5 to 0.5.
Eigen::Vector2d gradient(const Eigen::Matrix4d& c, double s, double t) {
    const Eigen::Vector4d ws(1, s, s * s, s * s * s), ds(0, 1, 2 * s, 3 * s * s);
    const Eigen::Vector4d wt(1, t, t * t, t * t * t), dt(0, 1, 2 * t, 3 * t * t);
    return {wt.dot(c * ds), dt.dot(c * ws)};
}

// c(j, i) of s^i t^j, through the tiles' corners.
Eigen::Matrix4d offsets_of(const EdgeOffset& offset, const UndistortionMap& map, int i, int j) {
    constexpr std::array corners{0, 1, 3, 4};
    std::array<Eigen::Vector4d, 4> rows;
    for (std::size_t row = 0; row < 4; ++row) {
        std::array<double, 4> values;
        for (std::size_t column = 0; column < 4; ++column)
            values[column] = offset.at(map.corner_in_group(i, j, corners[column], corners[row]));
        const std::array<double, 4> c = cubic_through_corners(values);
        rows[row] = {c[0], c[1], c[2], c[3]};
    }
    const std::array<Eigen::Vector4d, 4> by_power = cubic_through_corners(rows);
    Eigen::Matrix4d c;
    for (int power = 0; power < 4; ++power)
        c.row(power) = by_power[static_cast<std::size_t>(power)];
    return c;
}

}  // namespace

std::optional<OneEdge> one_edge(const MarkerView& view, const CellRange& range) {
    constexpr int most_cells = 64;
    const int columns = range.last_column - range.first_column;
    const int rows = range.last_row - range.first_row;
    if ((columns + 1) * (rows + 1) > most_cells)
        return std::nullopt;
    for (const int axis : {0, 1}) {
        const auto cell = [&](int along, int across) {
            return axis == 0 ? view.cell(range.first_column + along, range.first_row + across)
                             : view.cell(range.first_column + across, range.first_row + along);
        };
        const int length = axis == 0 ? columns : rows, width = axis == 0 ? rows : columns;
        int changes = 0, last = 0;
        bool is_alike = true;
        for (int n = 0; n <= length; ++n) {
            for (int across = 1; across <= width && is_alike; ++across)
                is_alike = cell(n, across) == cell(n, 0);
            if (n > 0 && cell(n, 0) != cell(n - 1, 0))
                ++changes, last = n;
        }
        if (is_alike && changes == 1)
            return OneEdge{axis, (axis == 0 ? range.first_column : range.first_row) + last,
                           cell(0, 0), cell(length, 0)};
    }
    return std::nullopt;
}

std::optional<EdgeGroup> edge_group(const MarkerView& view, const UndistortionMap& map, int i,
                                    int j, const OneEdge& edge, const EdgeTable& response,
                                    double gray) {
    constexpr double side = EdgeGroup::side_px, good_enough_px = 2e-4;
    if (view.aperture().faces_rays)
        return std::nullopt;
    const EdgeOffset offset(view, edge);
    const Eigen::Matrix4d c = offsets_of(offset, map, i, j);
    const Eigen::Vector2d middle = gradient(c, 0.0, 0.0) / side;
    const double blur = 1.0 / middle.norm();
    if (!(blur >= EdgeTable::least_blur_px && blur <= EdgeTable::largest_blur_px))
        return std::nullopt;
    // A cubic errs most in the middle.
    if (!(std::abs(offset.at(map.corner_in_group(i, j, 2, 2)) - c(0, 0)) * blur < good_enough_px))
        return std::nullopt;
    double bend = 0.0;
    for (const double s : {-0.5, 0.5})
        for (const double t : {-0.5, 0.5})
            bend = std::max(bend, (blur / side * gradient(c, s, t) - blur * middle).norm());
    if (!(std::abs(edge.beyond - edge.before) * bend * response.gray_of_bend(blur) <= gray))
        return std::nullopt;
    EdgeGroup group{i, j, {}, static_cast<float>(blur), 0.0f, 0.0f, 0.0f};
    for (int n = 0; n < 16; ++n)
        group.distance[static_cast<std::size_t>(n)] = static_cast<float>(blur * c(n / 4, n % 4));
    const double twice = 2.0 * middle.x() * middle.y() * blur * blur;
    group.diagonal = static_cast<float>(twice * twice);
    group.before = static_cast<float>(edge.before - view.background());
    group.beyond = static_cast<float>(edge.beyond - view.background());
    return group;
}

}  // namespace etalon
