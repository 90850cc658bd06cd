#include "sim/tiles/tile_evaluator.h"

#include <Eigen/LU>

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

// Where a linear form of (dx, dy, 1) is zero.
TileLine tile_line(const Eigen::Vector3d& form) {
    const double distance = form.z(), steepness = form.head<2>().norm();
    if (!(std::abs(distance) < far_away_px * steepness))
        return {static_cast<float>(std::copysign(far_away_px, distance)), 1.0f, 0.0f, 1.0f, 0.0f};
    const double scale = 1.0 / steepness;
    const auto x = static_cast<float>(form.x() * scale), y = static_cast<float>(form.y() * scale);
    return {static_cast<float>(distance * scale), x, y, x, y};
}

// A marker and a tile's points in the frame in which the tile sees them: the view's own, of a wide
// lens one that looks along the tile's middle ray (docs/rendering.md, "Wide lenses").
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

// What the tile kernels work on, in coordinates x' = to_px (x - centre) in which the blur disk is
// (nearly) round. `geometry` keeps its memory.
void set_geometry(const MarkerView& view, const TileView& seen, const CellRange& range,
                  const Eigen::Matrix2d& to_px, TileGeometry& geometry) {
    const TilePolynomial& place = seen.place;
    const double radius_mm = view.aperture().radius_mm;
    geometry.dx = coefficients(to_px(0, 0) * place.x + to_px(0, 1) * place.y);
    geometry.dy = coefficients(to_px(1, 0) * place.x + to_px(1, 1) * place.y);
    const double px = std::sqrt(std::abs(to_px.determinant()));
    const Eigen::Matrix2d from_px = to_px.inverse();
    const Eigen::Matrix2d by_px = px * from_px.transpose();
    const Eigen::Vector2d slope = radius_mm * by_px * seen.defocus_slope;
    const Eigen::Vector2d turn = radius_mm * by_px * seen.turn;
    geometry.blur = static_cast<float>(radius_mm * px * seen.defocus);
    geometry.blur_slope_x = static_cast<float>(slope.x());
    geometry.blur_slope_y = static_cast<float>(slope.y());
    geometry.turn_x = static_cast<float>(turn.x());
    geometry.turn_y = static_cast<float>(turn.y());
    geometry.disk = geometry.disk_cosine = 0.0f;
    Eigen::Matrix3d from_tile;
    from_tile << from_px, place.centre, 0.0, 0.0, 1.0;
    const Eigen::Matrix3d h = (seen.h * from_tile).transpose();  // columns: the forms U, V and W
    geometry.columns.clear();
    for (int i = range.first_column + 1; i <= range.last_column; ++i)
        geometry.columns.push_back(tile_line(h.col(0) - i * h.col(2)));
    geometry.rows.clear();
    for (int j = range.first_row + 1; j <= range.last_row; ++j)
        geometry.rows.push_back(tile_line(h.col(1) - j * h.col(2)));
    geometry.background = view.background();
    geometry.cells.clear();
    for (int j = range.first_row; j <= range.last_row; ++j)
        for (int i = range.first_column; i <= range.last_column; ++i)
            geometry.cells.push_back(view.cell(i, j));
}

// In sensor px (pitches along x), where a spread is round; the lines know by how much the blur is
// not. `pitch_y`: a pixel's height by its width.
void set_sensor_geometry(const MarkerView& view, const TilePolynomial& place,
                         const CellRange& range, double pitch_y, TileGeometry& geometry) {
    const TileView seen(view, place);
    const Eigen::Matrix2d to_px = to_sensor_px(seen.place, pitch_y);
    set_geometry(view, seen, range, to_px, geometry);
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

// For averages over the aperture and over a disk of this radius (px of the sensor) around the
// point: the mean over some cosines, see TileGeometry. Without the lens: over the disk alone. The
// disk is round in the px of the tile's own derivative: across a tile that changes by some 1e-4.
void set_disk_geometry(const MarkerView& view, const TilePolynomial& place, const CellRange& range,
                       bool with_lens, double radius_px, double pitch_y, TileGeometry& geometry) {
    const TileView seen(view, place);
    Eigen::Matrix2d to_px = to_sensor_px(seen.place, pitch_y);
    if (with_lens)
        to_px = rounding(view.aperture().radius_mm * seen.defocus * to_px, radius_px) * to_px;
    set_geometry(view, seen, range, to_px, geometry);
    if (!with_lens)
        geometry.blur = geometry.blur_slope_x = geometry.blur_slope_y = geometry.turn_x =
            geometry.turn_y = 0.0f;
    geometry.disk = static_cast<float>(radius_px);
}

// Of the points of a tile and a margin around it, at most `reach` from its centre in s and t.
Box box_around(const TilePolynomial& place, double reach) {
    const Eigen::Vector4d powers(1.0, reach, reach * reach, reach * reach * reach);
    const Eigen::Vector2d half(powers.dot(place.x.cwiseAbs() * powers),
                               powers.dot(place.y.cwiseAbs() * powers));
    return {place.centre - half, place.centre + half};
}

// A disk reaches beyond its tile by less than this times its radius, whatever the tile's shape.
constexpr double disk_reach = 1.25;

}  // namespace

// Wide enough that the quadrature's error stays below some hundredths of a gray
// (tests/sim/render/renderer_test.cpp).
LensRule lens_rule(double blur_radius_px, double sharp_up_to_px) {
    if (blur_radius_px <= sharp_up_to_px)
        return {1, 0};
    if (blur_radius_px < 0.04)
        return {2, 6};
    return blur_radius_px < 0.2 ? LensRule{3, 12} : LensRule{4, 24};
}

TilePositionsOf::TilePositionsOf(const Sampling& sampling) : samples(tile_px * sampling.k) {
    if (std::isfinite(sampling.exact_lens_from_px))
        quarters.emplace(2 * tile_px * sampling.k);
    const auto grid = [&](int k) {
        return Grid{k,
                    TilePositions(tile_px * k, TileInterpolation::margin),
                    {k, sampling.k, sampling.kind}};
    };
    for (const CoarseSampling& coarse : sampling.coarser)
        coarser.push_back(grid(coarse.k));
    if (sampling.direct_from_px > 0.0)
        finer.emplace(grid(2 * sampling.k));
}

TileEvaluator::TileEvaluator(const MarkerView& view, const UndistortionMap& map,
                             const Sampling& sampling, const TilePositionsOf& positions)
    : view_(view),
      map_(map),
      sampling_(sampling),
      positions_(positions),
      fx_(map.projector().camera().intrinsics.fx),
      smaller_focal_px_(sampling.least_blur_scale *
                        std::min(fx_, map.projector().camera().intrinsics.fy)),
      larger_focal_px_(sampling.largest_blur_scale *
                       std::max(fx_, map.projector().camera().intrinsics.fy)),
      lens_average_(view) {}

TileUse TileEvaluator::evaluate(int i, int j, const std::optional<CellRange>& range,
                                float* values) {
    if (!range) {
        const TileUse use = sample_one_by_one(i, j, values);
        // Of plans by a table no such tile sees the marker; both of its parts are one then.
        if (sampling_.kind == SampleKind::pixel)
            std::copy_n(values, tile_px * tile_px, values + tile_px * tile_px);
        return use;
    }
    const TilePolynomial place = map_.polynomial(i, j);
    for (std::size_t n = 0; n < positions_.coarser.size(); ++n) {
        const Grid& grid = positions_.coarser[n];
        if (least_blur_px(box_of(grid, place)) >= sampling_.coarser[n].from_blur_px)
            return sample_grid(grid, place, values);
    }
    if (sampling_.kind == SampleKind::pixel)
        return sample_pixels(place, *range, values);
    const Box& box = map_.bounds(i, j);
    if (positions_.finer && least_blur_px(box) < sampling_.direct_from_px)
        return sample_grid(*positions_.finer, place, values);
    if (sampling_.kind == SampleKind::disk)
        return sample_disks(place, box, *range, positions_.samples, values);
    set_lens_geometry(place, *range);
    if (sampling_.kind == SampleKind::point) {
        exact_lens_samples(geometry_, positions_.samples, values);
        return {RenderMethod::exact_lens, sampling_.k, 1, 1};
    }
    if (least_blur_px(box) >= sampling_.exact_lens_from_px)
        return sample_blurred_boxes(values);
    return sample_boxes(lens_rule(largest_blur_px(box), sampling_.sharp_up_to_px), values);
}

void TileEvaluator::set_lens_geometry(const TilePolynomial& place, const CellRange& range) {
    set_geometry(view_, TileView(view_, place), range, fx_ * Eigen::Matrix2d::Identity(),
                 geometry_);
}

double TileEvaluator::least_blur_px(const Box& box) const {
    return view_.aperture().radius_mm * smaller_focal_px_ * view_.smallest_defocus(box);
}

double TileEvaluator::largest_blur_px(const Box& box) const {
    return view_.aperture().radius_mm * larger_focal_px_ * view_.largest_defocus(box);
}

// Of a tile with the grid's margin, and of the disks around its samples.
Box TileEvaluator::box_of(const Grid& grid, const TilePolynomial& place) const {
    return box_around(place, 0.5 + TileInterpolation::margin / double(tile_px * grid.k) +
                                 disk_reach * sampling_.disk_radius_px / tile_px);
}

TileUse TileEvaluator::sample_grid(const Grid& grid, const TilePolynomial& place, float* values) {
    const Box box = box_of(grid, place);
    const CellRange range = view_.footprint(box).value_or(CellRange{-1, -1, -1, -1});
    const auto side = static_cast<std::size_t>(grid.positions.n);
    lens_averages_.resize(side * side);
    TileUse use{RenderMethod::exact_lens, grid.k, 1, 1};
    if (sampling_.kind == SampleKind::disk) {
        use = sample_disks(place, box, range, grid.positions, lens_averages_.data());
        use.points_per_pixel_side = grid.k;
    } else {
        set_lens_geometry(place, range);
        exact_lens_samples(geometry_, grid.positions, lens_averages_.data());
    }
    grid.interpolation.interpolate(lens_averages_.data(), scratch_, values);
    return use;
}

// Averages over the disk and the aperture, at once: concentric disks for both.
TileUse TileEvaluator::sample_disks(const TilePolynomial& place, const Box& box,
                                    const CellRange& range, const TilePositions& positions,
                                    float* values) {
    const Intrinsics& intrinsics = map_.projector().camera().intrinsics;
    const double blur = largest_blur_px(box);
    const int count = blur <= sampling_.one_disk_up_to_px ? 1 : sampling_.disks;
    set_disk_geometry(view_, place, range, blur > sampling_.sharp_up_to_px,
                      sampling_.disk_radius_px, intrinsics.fx / intrinsics.fy, geometry_);
    if (count == 1) {
        exact_lens_samples(geometry_, positions, values);
        return {RenderMethod::exact_area, sampling_.k, 1, 1};
    }
    if (std::ssize(disks_) != count)
        disks_ = concentric_disks(count);
    const auto n = static_cast<std::size_t>(positions.n);
    of_disk_.resize(n * n);
    std::fill_n(values, n * n, 0.0f);
    for (const ConcentricDisk& disk : disks_) {
        geometry_.disk_cosine = static_cast<float>(disk.cosine);
        exact_lens_samples(geometry_, positions, of_disk_.data());
        const auto weight = static_cast<float>(disk.weight);
        for (std::size_t p = 0; p < n * n; ++p)
            values[p] += weight * of_disk_[p];
    }
    return {RenderMethod::exact_area, sampling_.k, count, 1};
}

TileUse TileEvaluator::sample_blurred_boxes(float* values) {
    const auto n = static_cast<std::size_t>(tile_px * sampling_.k);
    lens_averages_.resize(4 * n * n);
    exact_lens_samples(geometry_, *positions_.quarters, lens_averages_.data());
    for (std::size_t y = 0; y < n; ++y) {
        const float* upper = &lens_averages_[4 * n * y];
        const float* lower = upper + 2 * n;
        for (std::size_t x = 0; x < n; ++x)
            values[n * y + x] =
                0.25f * ((upper[2 * x] + upper[2 * x + 1]) + (lower[2 * x] + lower[2 * x + 1]));
    }
    return {RenderMethod::exact_lens, 2 * sampling_.k, 1, 1};
}

// What the tail is summed over needs the blur's second moment only: four points have it.
TileUse TileEvaluator::sample_pixels(const TilePolynomial& place, const CellRange& range,
                                     float* values) {
    const Intrinsics& intrinsics = map_.projector().camera().intrinsics;
    const Box box = box_around(place, 0.5 + disk_reach * sampling_.wedge_reach_px / tile_px);
    set_sensor_geometry(view_, place, range, intrinsics.fx / intrinsics.fy, geometry_);
    wedge_pixels(geometry_, positions_.samples,
                 sampling_.wedges->rows(least_blur_px(box), largest_blur_px(box)), values);
    const bool is_sharp = largest_blur_px(box) <= sampling_.sharp_up_to_px;
    sample_boxes(is_sharp ? LensRule{1, 0} : LensRule{1, 4}, values + tile_px * tile_px);
    return {RenderMethod::wedge_table, 1, 1, 1};
}

TileUse TileEvaluator::sample_boxes(const LensRule& rule, float* values) {
    if (lens_points_of_ != rule.points()) {
        lens_points_.clear();
        for (const LensPoint& p : lens_points(1.0, rule))
            lens_points_.push_back({static_cast<float>(p.l_mm.x()), static_cast<float>(p.l_mm.y()),
                                    static_cast<float>(p.weight)});
        lens_points_of_ = rule.points();
    }
    exact_area_samples(geometry_, positions_.samples, lens_points_, values);
    return {RenderMethod::exact_area, sampling_.k, rule.points(), 1};
}

namespace {

// Whether the border of the valid region passes through a sample: one of its neighbours has a ray
// and it has not, or the other way round.
bool is_at_border(const CellTable<char>& rays, int column, int row) {
    bool differs = false;
    for_each_cell({column - 1, row - 1, 3, 3},
                  [&](int x, int y) { differs |= rays.at(x, y) != rays.at(column, row); });
    return differs;
}

}  // namespace

// The points of a grid with its margin, row by row; false if one of them has no ray.
bool TileEvaluator::find_points(const Grid& grid, int i, int j) {
    points_.clear();
    std::optional<MappedPoint> last;
    const Eigen::Vector2d corner = UndistortionMap::tile_corner_px(i, j);
    for (int row = 0; row < grid.positions.n; ++row)
        for (int column = 0; column < grid.positions.n; ++column) {
            const Eigen::Vector2d place(column + 0.5, row + 0.5);
            last =
                map_.exact(corner + (place - Eigen::Vector2d::Constant(TileInterpolation::margin)) /
                                        double(grid.k),
                           last);
            if (!last)
                return false;
            points_.push_back(last);
        }
    return true;
}

// Of a tile that is blurred enough for a coarser grid, all of whose points have rays: one where the
// undistortion bends too much for the polynomial.
std::optional<TileUse> TileEvaluator::sample_grid_one_by_one(int i, int j, float* values) {
    if (sampling_.kind == SampleKind::disk)
        return std::nullopt;
    for (std::size_t n = 0; n < positions_.coarser.size(); ++n) {
        const Grid& grid = positions_.coarser[n];
        const double from_px = sampling_.coarser[n].from_blur_px;
        if (least_blur_px(map_.bounds(i, j)) < from_px)
            continue;
        if (!find_points(grid, i, j))
            return std::nullopt;
        Box box{points_.front()->x, points_.front()->x};
        for (const auto& point : points_)
            box = {box.low.cwiseMin(point->x), box.high.cwiseMax(point->x)};
        if (least_blur_px(box) < from_px)
            continue;
        lens_averages_.clear();
        for (const auto& point : points_)
            lens_averages_.push_back(
                static_cast<float>(lens_average_at(point->x) - view_.background()));
        grid.interpolation.interpolate(lens_averages_.data(), scratch_, values);
        return TileUse{RenderMethod::exact_lens, grid.k, 1, 1};
    }
    return std::nullopt;
}

// Which of the tile's points have a ray, and which of the ring around them: the border may run
// between two tiles.
CellTable<char> TileEvaluator::rays_around(int i, int j) const {
    const int n = tile_px * sampling_.k;
    CellTable<char> rays({-1, -1, n + 2, n + 2});
    for_each_cell(rays.rect, [&](int column, int row) {
        const auto& nearest = points_[static_cast<std::size_t>(std::clamp(row, 0, n - 1) * n +
                                                               std::clamp(column, 0, n - 1))];
        const bool is_inside = row >= 0 && row < n && column >= 0 && column < n;
        const Eigen::Vector2d within(column + 0.5, row + 0.5);
        const Eigen::Vector2d corner = UndistortionMap::tile_corner_px(i, j);
        rays.at(column, row) = is_inside
                                   ? nearest.has_value()
                                   : map_.exact(corner + within / sampling_.k, nearest).has_value();
    });
    return rays;
}

// Lens averages of one pixel whose points are a cubic.
void TileEvaluator::sample_pixel(const TilePolynomial& cubic, const cv::Rect& samples,
                                 float* values) {
    if (!pixel_positions_)
        pixel_positions_.emplace(sampling_.k);
    lens_averages_.assign(static_cast<std::size_t>(samples.area()), 0.0f);
    if (const auto range = view_.footprint(box_around(cubic, 0.5))) {
        set_lens_geometry(cubic, *range);
        exact_lens_samples(geometry_, *pixel_positions_, lens_averages_.data());
    }
    for (int y = 0; y < samples.height; ++y)
        std::copy_n(&lens_averages_[static_cast<std::size_t>(y * samples.width)], samples.width,
                    values + (samples.y + y) * tile_px * sampling_.k + samples.x);
}

// Finds the points, pixel by pixel. Most pixels have a cubic of their own, which gives their lens
// averages at once: their middle then stands for their points. Says which samples have values.
std::vector<bool> TileEvaluator::find_points_by_pixel(int i, int j, float* values) {
    constexpr int block = 4;  // of the tile kernel
    const int k = sampling_.k, n = tile_px * k;
    std::vector<bool> done(static_cast<std::size_t>(n * n), false);
    if (sampling_.kind != SampleKind::point || k % block != 0) {
        map_.sample(i, j, n, points_);
        return done;
    }
    points_.assign(done.size(), std::nullopt);
    std::optional<MappedPoint> last;
    for (int pixel = 0; pixel < tile_px * tile_px; ++pixel) {
        const cv::Point in_tile(pixel % tile_px, pixel / tile_px);
        const Eigen::Vector2d corner =
            UndistortionMap::tile_corner_px(i, j) + Eigen::Vector2d(in_tile.x, in_tile.y);
        const auto cubic =
            last ? map_.cubic_within(corner, 1.0,
                                     {last->x, Eigen::Matrix4d::Zero(), Eigen::Matrix4d::Zero()})
                 : std::nullopt;
        if (cubic) {
            last = MappedPoint{cubic->centre, Eigen::Matrix2d::Zero()};
            sample_pixel(*cubic, {k * in_tile, cv::Size(k, k)}, values);
        }
        for (int q = 0; q < k * k; ++q) {
            const auto at =
                static_cast<std::size_t>((k * in_tile.y + q / k) * n + k * in_tile.x + q % k);
            points_[at] =
                cubic ? last
                      : map_.exact(corner + Eigen::Vector2d(q % k + 0.5, q / k + 0.5) / k, last);
            done[at] = cubic.has_value();
            if (points_[at])
                last = points_[at];
        }
    }
    return done;
}

// Where some of a tile's points have no ray: those are background.
TileUse TileEvaluator::sample_one_by_one(int i, int j, float* values) {
    if (const auto use = sample_grid_one_by_one(i, j, values))
        return *use;
    const int n = tile_px * sampling_.k;
    const std::vector<bool> done = find_points_by_pixel(i, j, values);
    const CellTable<char> rays = rays_around(i, j);
    for (int p = 0; p < n * n; ++p) {
        const auto& point = points_[static_cast<std::size_t>(p)];
        double radiance = view_.background();
        if (is_at_border(rays, p % n, p / n))
            radiance = mean_of_parts(i, j, p % n, p / n);
        else if (done[static_cast<std::size_t>(p)])
            continue;
        else if (point)
            radiance = radiance_at(*point, 1.0 / sampling_.k);
        values[p] = static_cast<float>(radiance - view_.background());
    }
    if (sampling_.kind == SampleKind::point)
        return {RenderMethod::exact_lens, sampling_.k, 1, 1};
    return {RenderMethod::exact_area, sampling_.k, std::max(coverage_of_, 1), 1};
}

// On a Fibonacci lattice (Niederreiter, "Random Number Generation and Quasi-Monte Carlo Methods",
// 1992, 5.1): a border along the pixels' rows is found to a thousandth of a pixel.
double TileEvaluator::mean_of_parts(int i, int j, int column, int row) {
    int points = 34, generator = 21;  // two Fibonacci numbers in a row
    while (points < 1000 / sampling_.k)
        points += std::exchange(generator, points);
    const double sample_px = 1.0 / sampling_.k, part_px = sample_px / std::sqrt(points);
    double sum = 0.0;
    std::optional<MappedPoint> near =
        points_[static_cast<std::size_t>(row * tile_px * sampling_.k + column)];
    for (int q = 0; q < points; ++q) {
        const Eigen::Vector2d part =
            Eigen::Vector2d(q + 0.5, q * generator % points + 0.5) / points;
        const auto point = map_.exact(UndistortionMap::tile_corner_px(i, j) +
                                          sample_px * (Eigen::Vector2d(column, row) + part),
                                      near);
        if (point)
            near = point;
        sum += point ? radiance_at(*point, part_px) : view_.background();
    }
    return sum / points;
}

double TileEvaluator::lens_average_at(const Eigen::Vector2d& x) {
    const auto range = view_.footprint({x, x});
    return range ? lens_average_.at(x, *range) : view_.background();
}

// Of a point, or of a box of this side around it (a disk: a square with its second moment): of
// blurred ones the mean of 2 x 2 lens averages.
double TileEvaluator::radiance_at(const MappedPoint& point, double side_px) {
    if (sampling_.kind == SampleKind::point)
        return lens_average_at(point.x);
    if (sampling_.kind == SampleKind::box &&
        least_blur_px({point.x, point.x}) >= sampling_.exact_lens_from_px) {
        double sum = 0.0;
        for (const double s : {-0.25, 0.25})
            for (const double t : {-0.25, 0.25})
                sum +=
                    lens_average_at(point.x + point.jacobian * (side_px * Eigen::Vector2d(s, t)));
        return 0.25 * sum;
    }
    if (sampling_.kind == SampleKind::disk)
        side_px = std::sqrt(3.0) * sampling_.disk_radius_px;
    const Eigen::Matrix2d sides = point.jacobian * side_px;
    const Eigen::Vector2d half = 0.5 * sides.cwiseAbs().rowwise().sum();
    const auto range = view_.footprint({point.x - half, point.x + half});
    if (!range)
        return view_.background();
    const LensRule rule = lens_rule(largest_blur_px({point.x, point.x}), sampling_.sharp_up_to_px);
    if (!coverage_ || coverage_of_ != rule.points()) {
        coverage_.emplace(view_, lens_points(view_.aperture().radius_mm, rule));
        coverage_of_ = rule.points();
    }
    return coverage_->over(point.x, sides, *range);
}

}  // namespace etalon
