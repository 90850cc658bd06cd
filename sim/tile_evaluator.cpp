#include "sim/tile_evaluator.h"

namespace etalon {
namespace {

constexpr int tile_px = UndistortionMap::tile_px;

// Of the parallelogram that a sample's box becomes.
Box parallelogram_box(const Eigen::Vector2d& x, const Eigen::Matrix2d& sides) {
    const Eigen::Vector2d half = 0.5 * sides.cwiseAbs().rowwise().sum();
    return {x - half, x + half};
}

// Of the points of a tile and a margin around it, at most `reach` from its centre in s and t.
Box box_around(const TilePolynomial& place, double reach) {
    Eigen::Vector2d half = Eigen::Vector2d::Zero();
    for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 4; ++i)
            half += std::pow(reach, i + j) *
                    Eigen::Vector2d(std::abs(place.x(j, i)), std::abs(place.y(j, i)));
    return {place.centre - half, place.centre + half};
}

constexpr LensRule finest_rule{4, 24};

}  // namespace

// Wide enough that the quadrature's error stays below some hundredths of a gray
// (tests/sim/renderer_test.cpp).
LensRule lens_rule(double blur_radius_px, double sharp_up_to_px) {
    if (blur_radius_px <= sharp_up_to_px)
        return {1, 0};
    if (blur_radius_px < 0.04)
        return {2, 6};
    return blur_radius_px < 0.2 ? LensRule{3, 12} : finest_rule;
}

TilePositionsOf::TilePositionsOf(const Sampling& sampling)
    : samples(tile_px * sampling.k), quarters(2 * tile_px * sampling.k) {
    for (const CoarseSampling& coarse : sampling.coarser)
        coarser.push_back({coarse,
                           {tile_px * coarse.k, TileInterpolation::margin},
                           {coarse.k, sampling.k, sampling.kind}});
}

TileEvaluator::TileEvaluator(const MarkerView& view, const UndistortionMap& map,
                             const Sampling& sampling, const TilePositionsOf& positions)
    : view_(view),
      map_(map),
      sampling_(sampling),
      positions_(positions),
      fx_(map.projector().camera().intrinsics.fx),
      smaller_focal_px_(std::min(fx_, map.projector().camera().intrinsics.fy)),
      larger_focal_px_(std::max(fx_, map.projector().camera().intrinsics.fy)),
      lens_average_(view) {}

TileUse TileEvaluator::evaluate(int i, int j, const std::optional<CellRange>& range,
                                float* values) {
    if (!range)
        return sample_one_by_one(i, j, values);
    if (sampling_.kind == SampleKind::disk)
        return sample_disks(i, j, *range, values);
    const TilePolynomial place = map_.polynomial(i, j);
    for (const Coarse& coarse : positions_.coarser) {
        const double reach = 0.5 + TileInterpolation::margin / double(tile_px * coarse.sampling.k);
        const Box box = box_around(place, reach);
        if (least_blur_px(box) >= coarse.sampling.from_blur_px)
            return sample_coarsely(coarse, place, box, values);
    }
    set_tile_geometry(view_, place, *range, fx_, geometry_);
    if (sampling_.kind == SampleKind::point)
        return sample_points(values);
    const Box& box = map_.bounds(i, j);
    if (least_blur_px(box) >= sampling_.exact_lens_from_px)
        return sample_blurred_boxes(values);
    return sample_boxes(view_.aperture().radius_mm * larger_focal_px_ * view_.largest_defocus(box),
                        values);
}

double TileEvaluator::least_blur_px(const Box& box) const {
    return view_.aperture().radius_mm * smaller_focal_px_ * view_.smallest_defocus(box);
}

TileUse TileEvaluator::sample_coarsely(const Coarse& coarse, const TilePolynomial& place,
                                       const Box& box, float* values) {
    const auto range = view_.footprint(box);
    set_tile_geometry(view_, place, range.value_or(CellRange{-1, -1, -1, -1}), fx_, geometry_);
    const auto side = static_cast<std::size_t>(coarse.positions.n());
    lens_averages_.resize(side * side);
    exact_lens_samples(geometry_, coarse.positions, lens_averages_.data());
    coarse.interpolation.interpolate(lens_averages_.data(), scratch_, values);
    return {RenderMethod::exact_lens, coarse.sampling.k, 1, 1};
}

TileUse TileEvaluator::sample_points(float* values) {
    exact_lens_samples(geometry_, positions_.samples, values);
    return {RenderMethod::exact_lens, sampling_.k, 1, 1};
}

TileUse TileEvaluator::sample_disks(int i, int j, const CellRange& range, float* values) {
    const Intrinsics& intrinsics = map_.projector().camera().intrinsics;
    set_disk_geometry(view_, map_.polynomial(i, j), range, sampling_.disk_radius_px,
                      intrinsics.fx / intrinsics.fy, geometry_);
    exact_lens_samples(geometry_, positions_.samples, values);
    return {RenderMethod::exact_area, sampling_.k, 1, 1};
}

TileUse TileEvaluator::sample_blurred_boxes(float* values) {
    const auto n = static_cast<std::size_t>(tile_px * sampling_.k);
    lens_averages_.resize(4 * n * n);
    exact_lens_samples(geometry_, positions_.quarters, lens_averages_.data());
    for (std::size_t y = 0; y < n; ++y) {
        const float* upper = &lens_averages_[4 * n * y];
        const float* lower = upper + 2 * n;
        for (std::size_t x = 0; x < n; ++x)
            values[n * y + x] =
                0.25f * ((upper[2 * x] + upper[2 * x + 1]) + (lower[2 * x] + lower[2 * x + 1]));
    }
    return {RenderMethod::exact_lens, 2 * sampling_.k, 1, 1};
}

TileUse TileEvaluator::sample_boxes(double blur_radius_px, float* values) {
    const LensRule rule = lens_rule(blur_radius_px, sampling_.sharp_up_to_px);
    if (lens_points_of_ != rule.points()) {
        lens_points_.clear();
        for (const LensPoint& p : lens_points(1.0, rule.rings, rule.spokes))
            lens_points_.push_back({static_cast<float>(p.l_mm.x()), static_cast<float>(p.l_mm.y()),
                                    static_cast<float>(p.weight)});
        lens_points_of_ = rule.points();
    }
    exact_area_samples(geometry_, positions_.samples, lens_points_, values);
    return {RenderMethod::exact_area, sampling_.k, rule.points(), 1};
}

namespace {

// Whether one of a sample's neighbours in the tile has a ray and the sample has not, or the other
// way round: the border of the valid region passes through it, and only a part of it sees anything.
bool is_at_border(const std::vector<std::optional<MappedPoint>>& points, int n, int column,
                  int row) {
    const auto has_ray = [&](int x, int y) {
        return points[static_cast<std::size_t>(y * n + x)].has_value();
    };
    for (int y = std::max(0, row - 1); y <= std::min(n - 1, row + 1); ++y)
        for (int x = std::max(0, column - 1); x <= std::min(n - 1, column + 1); ++x)
            if (has_ray(x, y) != has_ray(column, row))
                return true;
    return false;
}

}  // namespace

// Where some of a tile's points have no ray: those are background.
TileUse TileEvaluator::sample_one_by_one(int i, int j, float* values) {
    const int n = tile_px * sampling_.k;
    map_.sample(i, j, n, points_);
    for (int p = 0; p < n * n; ++p) {
        const auto& point = points_[static_cast<std::size_t>(p)];
        double radiance = view_.background();
        if (is_at_border(points_, n, p % n, p / n))
            radiance = mean_of_parts(i, j, p % n, p / n);
        else if (point)
            radiance = radiance_at(*point, 1.0 / sampling_.k);
        values[p] = static_cast<float>(radiance - view_.background());
    }
    if (sampling_.kind == SampleKind::point)
        return {RenderMethod::exact_lens, sampling_.k, 1, 1};
    return {RenderMethod::exact_area, sampling_.k, finest_rule.points(), 1};
}

double TileEvaluator::mean_of_parts(int i, int j, int column, int row) {
    constexpr int parts = 4;
    const double sample_px = 1.0 / sampling_.k;
    double sum = 0.0;
    for (int q = 0; q < parts * parts; ++q) {
        const Eigen::Vector2d place(column + (q % parts + 0.5) / parts,
                                    row + (q / parts + 0.5) / parts);
        const auto point = map_.exact(UndistortionMap::tile_corner_px(i, j) + sample_px * place);
        sum += point ? radiance_at(*point, sample_px / parts) : view_.background();
    }
    return sum / (parts * parts);
}

// Of a point, or of a box of this side around it (a disk: a square with its second moment).
double TileEvaluator::radiance_at(const MappedPoint& point, double side_px) {
    if (sampling_.kind == SampleKind::point) {
        const auto range = view_.footprint({point.x, point.x});
        return range ? lens_average_.at(point.x, *range) : view_.background();
    }
    if (sampling_.kind == SampleKind::disk)
        side_px = std::sqrt(3.0) * sampling_.disk_radius_px;
    const Eigen::Matrix2d sides = point.jacobian * side_px;
    const auto range = view_.footprint(parallelogram_box(point.x, sides));
    if (!range)
        return view_.background();
    if (!coverage_)
        coverage_.emplace(view_, lens_points(view_.aperture().radius_mm, finest_rule.rings,
                                             finest_rule.spokes));
    return coverage_->over(point.x, sides, *range);
}

}  // namespace etalon
