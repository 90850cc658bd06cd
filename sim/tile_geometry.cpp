#include "sim/tile_geometry.h"

#include <cmath>

namespace etalon {
namespace {

std::array<float, 16> in_px(const Eigen::Matrix4d& coefficients, double fx) {
    std::array<float, 16> result;
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i)
            result[static_cast<std::size_t>(4 * j + i)] =
                static_cast<float>(fx * coefficients(j, i));
    return result;
}

// Lines far beyond every ray of the tile are as good at this distance, and finite.
constexpr double far_away_px = 1e8;

TileLine tile_line(const MarkerView& view, int axis, int index, const Eigen::Vector2d& centre,
                   double fx) {
    const Eigen::Vector3d line = view.h().row(axis) - index * view.h().row(2);
    const double distance = line.head<2>().dot(centre) + line.z();
    const double steepness = line.head<2>().norm();
    if (!(std::abs(distance) * fx < far_away_px * steepness))
        return {static_cast<float>(std::copysign(far_away_px, distance)), 1.0f, 0.0f};
    const Eigen::Vector2d gradient = line.head<2>() / steepness;
    return {static_cast<float>(distance * fx / steepness), static_cast<float>(gradient.x()),
            static_cast<float>(gradient.y())};
}

}  // namespace

void set_tile_geometry(const MarkerView& view, const TilePolynomial& place, const CellRange& range,
                       double fx, TileGeometry& geometry) {
    const double radius = view.aperture().radius_mm;
    geometry.dx = in_px(place.x, fx);
    geometry.dy = in_px(place.y, fx);
    geometry.blur = static_cast<float>(radius * fx * view.defocus(place.centre));
    const Eigen::Vector2d slope = radius * view.defocus_slope(), turn = radius * view.turn();
    geometry.blur_slope_x = static_cast<float>(slope.x());
    geometry.blur_slope_y = static_cast<float>(slope.y());
    geometry.turn_x = static_cast<float>(turn.x());
    geometry.turn_y = static_cast<float>(turn.y());

    const auto cell = [&](int column, int row) { return view.cell(column, row); };
    const int first_column = range.first_column, first_row = range.first_row;
    geometry.base = static_cast<float>(cell(first_column, first_row) - view.background());
    geometry.columns.clear();
    geometry.column_contrast.clear();
    for (int i = first_column + 1; i <= range.last_column; ++i) {
        geometry.columns.push_back(tile_line(view, 0, i, place.centre, fx));
        geometry.column_contrast.push_back(
            static_cast<float>(cell(i, first_row) - cell(i - 1, first_row)));
    }
    geometry.rows.clear();
    geometry.row_contrast.clear();
    geometry.mixed.clear();
    for (int j = first_row + 1; j <= range.last_row; ++j) {
        geometry.rows.push_back(tile_line(view, 1, j, place.centre, fx));
        geometry.row_contrast.push_back(
            static_cast<float>(cell(first_column, j) - cell(first_column, j - 1)));
        for (int i = first_column + 1; i <= range.last_column; ++i)
            geometry.mixed.push_back(static_cast<float>(cell(i, j) - cell(i - 1, j) -
                                                        cell(i, j - 1) + cell(i - 1, j - 1)));
    }
}

}  // namespace etalon
