#include "sim/tiles/edge_group.h"

#include <Eigen/LU>

namespace etalon {
namespace {

// From values at -1/2, -1/4, 1/4 and 1/2 to the coefficients of the cubic through them.
const Eigen::Matrix4d& cubic_through_corners() {
    static const Eigen::Matrix4d inverse = [] {
        Eigen::Matrix4d powers;
        const Eigen::Array4d x(-0.5, -0.25, 0.25, 0.5);
        powers << Eigen::Array4d::Ones(), x, x.square(), x.cube();
        return Eigen::Matrix4d(powers.inverse());
    }();
    return inverse;
}

// By the place in the group, from -0.5 to 0.5.
Eigen::Vector2d gradient(const Eigen::Matrix4d& c, double s, double t) {
    const Eigen::Vector4d ws(1, s, s * s, s * s * s), ds(0, 1, 2 * s, 3 * s * s);
    const Eigen::Vector4d wt(1, t, t * t, t * t * t), dt(0, 1, 2 * t, 3 * t * t);
    return {wt.dot(c * ds), dt.dot(c * ws)};
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
    // D / |w| in units of the aperture's radius: all of the line on the lens that its segment's
    // area depends on.
    const auto offset_at = [&](int column, int row) {
        const SensorPoint point = view.sensor_point(map.corner_in_group(i, j, column, row));
        const LensLine line = view.lens_line(edge.axis, edge.index, point);
        return line.offset / (view.aperture().radius_mm * line.slope.norm());
    };
    constexpr int corners[]{0, 1, 3, 4};
    Eigen::Matrix4d offsets;
    for (int n = 0; n < 16; ++n)
        offsets(n / 4, n % 4) = offset_at(corners[n % 4], corners[n / 4]);
    // c(j, i) of s^i t^j.
    const Eigen::Matrix4d c =
        cubic_through_corners() * offsets * cubic_through_corners().transpose();
    const Eigen::Vector2d middle = gradient(c, 0.0, 0.0) / side;
    const double blur = 1.0 / middle.norm();
    if (!(blur >= EdgeTable::least_blur_px && blur <= EdgeTable::largest_blur_px))
        return std::nullopt;
    // A cubic errs most in the middle.
    if (!(std::abs(offset_at(2, 2) - c(0, 0)) * blur < good_enough_px))
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
