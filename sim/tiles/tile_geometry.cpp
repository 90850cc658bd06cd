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
        return {static_cast<float>(std::copysign(far_away_px, distance)), 1.0f, 0.0f, 1.0f, 0.0f};
    const double scale = 1.0 / steepness;
    const auto x = static_cast<float>(gradient.x() * scale);
    const auto y = static_cast<float>(gradient.y() * scale);
    return {static_cast<float>(distance * scale), x, y, x, y};
}

// A marker and a tile's points in the frame in which the tile sees them: the view's own, but of a
// wide lens one that looks along the tile's middle ray, about which the pupil stays round and the
// focus flat to second order.
struct TileView {
    Eigen::Matrix3d h;
    TilePolynomial place;
    double defocus;  // at the tile's middle, as what follows
    Eigen::Vector2d defocus_slope, turn;

    TileView(const MarkerView& view, const TilePolynomial& in_view)
        : h(view.h()),
          place(in_view),
          defocus(view.defocus(in_view.centre)),
          defocus_slope(view.defocus_slope(in_view.centre)),
          turn(view.turn(in_view.centre)) {
        if (!view.aperture().faces_rays)
            return;
        const Eigen::Vector3d ray = in_view.centre.homogeneous();
        const Eigen::Matrix3d to_tile =
            rotation_between(ray, Eigen::Vector3d::UnitZ()).toRotationMatrix();
        h = view.h() * to_tile.transpose();
        place = turned(in_view, to_tile);
        // Towards the middle of the turned points, which is the ray's but for the cubic's error.
        const Eigen::Vector3d e = to_tile * view.depth_row();
        defocus = e.dot(place.centre.homogeneous()) - view.aperture().focus(place.centre);
        defocus_slope = turn = e.head<2>() - view.aperture().focus_gradient(place.centre);
    }
};

// By the derivative at the tile's middle.
Eigen::Matrix2d to_sensor_px(const TilePolynomial& place, double pitch_y) {
    Eigen::Matrix2d by_place;  // d x / d (s, t)
    by_place << place.x(0, 1), place.x(1, 0), place.y(0, 1), place.y(1, 0);
    return Eigen::Vector2d(tile_px, tile_px * pitch_y).asDiagonal() * by_place.inverse();
}

// Everything but the polynomials and the lens: lines in coordinates x' = to_px (x - centre).
void set_lines(const MarkerView& view, const TileView& seen, const CellRange& range,
               const Eigen::Matrix2d& to_px, TileGeometry& geometry) {
    const Eigen::Vector2d& centre = seen.place.centre;
    const auto cell = [&](int column, int row) { return view.cell(column, row); };
    const Eigen::Matrix2d from_px = to_px.inverse();
    const TileForm u(seen.h.row(0), centre, from_px), v(seen.h.row(1), centre, from_px);
    const TileForm w(seen.h.row(2), centre, from_px);
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
// (nearly) round.
void set_lens(double radius_mm, const TileView& seen, const Eigen::Matrix2d& to_px,
              TileGeometry& geometry) {
    const TilePolynomial& place = seen.place;
    geometry.dx = coefficients(to_px(0, 0) * place.x + to_px(0, 1) * place.y);
    geometry.dy = coefficients(to_px(1, 0) * place.x + to_px(1, 1) * place.y);
    const double px = std::sqrt(std::abs(to_px.determinant()));
    const Eigen::Matrix2d by_px = px * to_px.inverse().transpose();
    const Eigen::Vector2d slope = radius_mm * by_px * seen.defocus_slope;
    const Eigen::Vector2d turn = radius_mm * by_px * seen.turn;
    geometry.blur = static_cast<float>(radius_mm * px * seen.defocus);
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
    const TileView seen(view, place);
    const Eigen::Matrix2d to_px = fx * Eigen::Matrix2d::Identity();
    set_lens(view.aperture().radius_mm, seen, to_px, geometry);
    geometry.disk = geometry.disk_cosine = 0.0f;
    set_lines(view, seen, range, to_px, geometry);
}

void set_sensor_geometry(const MarkerView& view, const TilePolynomial& place,
                         const CellRange& range, double pitch_y, TileGeometry& geometry) {
    const TileView seen(view, place);
    const Eigen::Matrix2d to_px = to_sensor_px(seen.place, pitch_y);
    set_lens(view.aperture().radius_mm, seen, to_px, geometry);
    geometry.disk = geometry.disk_cosine = 0.0f;
    set_lines(view, seen, range, to_px, geometry);
    const Eigen::Vector2d turn = view.aperture().radius_mm * seen.turn;
    geometry.lens_turn_x = static_cast<float>(turn.x());
    geometry.lens_turn_y = static_cast<float>(turn.y());
    const Eigen::Matrix2d shape = to_px.transpose() / std::sqrt(std::abs(to_px.determinant()));
    for (std::vector<TileLine>* lines : {&geometry.columns, &geometry.rows})
        for (TileLine& line : *lines) {
            const Eigen::Vector2d blur = shape * Eigen::Vector2d(line.gradient_x, line.gradient_y);
            line.blur_x = static_cast<float>(blur.x());
            line.blur_y = static_cast<float>(blur.y());
        }
}

// The tile's own derivative takes its points to px, so that the disk is round there: across a tile
// it changes by some 1e-4, and the disk's second moment with it.
void set_disk_geometry(const MarkerView& view, const TilePolynomial& place, const CellRange& range,
                       bool with_lens, double radius_px, double pitch_y, TileGeometry& geometry) {
    const TileView seen(view, place);
    Eigen::Matrix2d to_px = to_sensor_px(seen.place, pitch_y);
    if (with_lens)
        to_px = rounding(view.aperture().radius_mm * seen.defocus * to_px, radius_px) * to_px;
    set_lens(view.aperture().radius_mm, seen, to_px, geometry);
    if (!with_lens)
        geometry.blur = geometry.blur_slope_x = geometry.blur_slope_y = geometry.turn_x =
            geometry.turn_y = 0.0f;
    geometry.disk = static_cast<float>(radius_px);
    geometry.disk_cosine = 0.0f;
    set_lines(view, seen, range, to_px, geometry);
}

}  // namespace etalon
