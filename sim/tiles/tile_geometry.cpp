#include "sim/tiles/tile_geometry.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>

namespace etalon {
namespace {

std::array<float, 16> coefficients(const Eigen::Matrix4d& polynomial) {
    std::array<float, 16> result;
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i)
            result[static_cast<std::size_t>(4 * j + i)] = static_cast<float>(polynomial(j, i));
    return result;
}

// Lines far beyond every ray of the tile are as good at this distance, and finite.
constexpr double far_away_px = 1e8;

// A linear form of the sensor point as seen from a tile: its value at the centre and its change
// per px. `from_px`: d x / d px.
struct TileForm {
    double value;
    Eigen::Vector2d gradient;

    TileForm(const Eigen::Vector3d& form, const Eigen::Vector2d& centre,
             const Eigen::Matrix2d& from_px)
        : value(form.head<2>().dot(centre) + form.z()),
          gradient(from_px.transpose() * form.head<2>()) {}
};

// The line h_axis - index h2.
TileLine tile_line(const TileForm& axis, const TileForm& w, int index) {
    const double distance = axis.value - index * w.value;
    const Eigen::Vector2d gradient = axis.gradient - index * w.gradient;
    const double steepness = gradient.norm();
    if (!(std::abs(distance) < far_away_px * steepness))
        return {static_cast<float>(std::copysign(far_away_px, distance)), 1.0f, 0.0f};
    const double scale = 1.0 / steepness;
    return {static_cast<float>(distance * scale), static_cast<float>(gradient.x() * scale),
            static_cast<float>(gradient.y() * scale)};
}

// Everything but the polynomials and the lens: lines in coordinates x' = to_px (x - centre).
void set_lines(const MarkerView& view, const Eigen::Vector2d& centre, const CellRange& range,
               const Eigen::Matrix2d& to_px, TileGeometry& geometry) {
    const auto cell = [&](int column, int row) { return view.cell(column, row); };
    const Eigen::Matrix2d from_px = to_px.inverse();
    const TileForm u(view.h().row(0), centre, from_px), v(view.h().row(1), centre, from_px);
    const TileForm w(view.h().row(2), centre, from_px);
    const int first_column = range.first_column, first_row = range.first_row;
    geometry.base = static_cast<float>(cell(first_column, first_row) - view.background());
    geometry.columns.clear();
    geometry.column_contrast.clear();
    for (int i = first_column + 1; i <= range.last_column; ++i) {
        geometry.columns.push_back(tile_line(u, w, i));
        geometry.column_contrast.push_back(
            static_cast<float>(cell(i, first_row) - cell(i - 1, first_row)));
    }
    geometry.rows.clear();
    geometry.row_contrast.clear();
    geometry.mixed.clear();
    for (int j = first_row + 1; j <= range.last_row; ++j) {
        geometry.rows.push_back(tile_line(v, w, j));
        geometry.row_contrast.push_back(
            static_cast<float>(cell(first_column, j) - cell(first_column, j - 1)));
        for (int i = first_column + 1; i <= range.last_column; ++i)
            geometry.mixed.push_back(static_cast<float>(cell(i, j) - cell(i - 1, j) -
                                                        cell(i, j - 1) + cell(i - 1, j - 1)));
    }
}

// The polynomials and the lens in coordinates x' = to_px (x - centre) in which the blur disk is
// (nearly) round. The lens points are those of the round pupil, turned.
void set_lens(const MarkerView& view, const TilePolynomial& place, const Eigen::Matrix2d& to_px,
              TileGeometry& geometry) {
    geometry.dx = coefficients(to_px(0, 0) * place.x + to_px(0, 1) * place.y);
    geometry.dy = coefficients(to_px(1, 0) * place.x + to_px(1, 1) * place.y);
    const double radius = view.aperture().radius_mm;
    const double px = std::sqrt(
        std::abs(to_px.determinant() * view.aperture().pupil(place.centre).determinant()));
    const Eigen::Matrix2d by_px = px * to_px.inverse().transpose();
    const Eigen::Vector2d slope = radius * by_px * view.defocus_slope(place.centre);
    const Eigen::Vector2d turn = radius * by_px * view.turn(place.centre);
    geometry.blur = static_cast<float>(radius * px * view.defocus(place.centre));
    geometry.blur_slope_x = static_cast<float>(slope.x());
    geometry.blur_slope_y = static_cast<float>(slope.y());
    geometry.turn_x = static_cast<float>(turn.x());
    geometry.turn_y = static_cast<float>(turn.y());
}

// From sensor px to the coordinates, of the same scale, in which the disk and the blur of the
// tile's centre together are round: on the sensor the blur is an ellipse, for the distortion.
Eigen::Matrix2d rounding(const Eigen::Matrix2d& blur_ellipse, double disk_px) {
    const Eigen::Matrix2d shape =
        blur_ellipse * blur_ellipse.transpose() + disk_px * disk_px * Eigen::Matrix2d::Identity();
    // Cayley and Hamilton: with s^2 the determinant and t^2 the trace + 2 s, the root is
    // (shape + s) / t and its determinant s.
    const double s = std::sqrt(shape.determinant()), t = std::sqrt(shape.trace() + 2.0 * s);
    Eigen::Matrix2d inverse_root;
    inverse_root << shape(1, 1) + s, -shape(0, 1), -shape(1, 0), shape(0, 0) + s;
    return inverse_root / (t * std::sqrt(s));
}

}  // namespace

void set_tile_geometry(const MarkerView& view, const TilePolynomial& place, const CellRange& range,
                       double fx, TileGeometry& geometry) {
    Eigen::Matrix2d to_px = fx * Eigen::Matrix2d::Identity();
    if (view.aperture().faces_rays) {  // where the pupil is round
        const Eigen::Matrix2d pupil = view.aperture().pupil(place.centre);
        to_px *= std::sqrt(pupil.determinant()) * pupil.inverse();
    }
    set_lens(view, place, to_px, geometry);
    geometry.disk = geometry.disk_cosine = 0.0f;
    set_lines(view, place.centre, range, to_px, geometry);
}

// The tile's own derivative takes its points to px, so that the disk is round there: across a tile
// it changes by some 1e-4, and the disk's second moment with it.
void set_disk_geometry(const MarkerView& view, const TilePolynomial& place, const CellRange& range,
                       bool with_lens, double radius_px, double pitch_y, TileGeometry& geometry) {
    Eigen::Matrix2d by_place;  // d x / d (s, t)
    by_place << place.x(0, 1), place.x(1, 0), place.y(0, 1), place.y(1, 0);
    Eigen::Matrix2d to_px =
        Eigen::Vector2d(tile_px, tile_px * pitch_y).asDiagonal() * by_place.inverse();
    if (with_lens) {
        const double blur = view.aperture().radius_mm * view.defocus(place.centre);
        to_px = rounding(blur * to_px * view.aperture().pupil(place.centre), radius_px) * to_px;
    }
    set_lens(view, place, to_px, geometry);
    if (!with_lens)
        geometry.blur = geometry.blur_slope_x = geometry.blur_slope_y = geometry.turn_x =
            geometry.turn_y = 0.0f;
    geometry.disk = static_cast<float>(radius_px);
    geometry.disk_cosine = 0.0f;
    set_lines(view, place.centre, range, to_px, geometry);
}

}  // namespace etalon
