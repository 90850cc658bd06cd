#include "sim/tile_samples.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "sim/cell_coverage.h"
#include "sim/lens_average.h"

namespace etalon {
namespace {

constexpr int tile_px = UndistortionMap::tile_px;

Box point_box(const Eigen::Vector2d& x) {
    return {x, x};
}

// Of the parallelogram that a sample's box becomes.
Box parallelogram_box(const Eigen::Vector2d& x, const Eigen::Matrix2d& sides) {
    const Eigen::Vector2d half = 0.5 * sides.cwiseAbs().rowwise().sum();
    return {x - half, x + half};
}

}  // namespace

// Evaluates tiles one after the other; holds the scratch memory of one thread.
class TileSamples::Evaluator {
public:
    Evaluator(const MarkerView& view, const UndistortionMap& map, const Sampling& sampling)
        : view_(view),
          map_(map),
          sampling_(sampling),
          lens_average_(view),
          coverage_(view, lens_points(view.aperture().radius_mm, sampling.lens_rings,
                                      sampling.lens_spokes)) {}

    void evaluate(int i, int j, Tile& tile) {
        const auto validity = map_.validity(i, j);
        if (validity == UndistortionMap::Validity::none)
            return;  // background
        std::optional<CellRange> range;
        bool blurred = true;  // at the border of the valid region: decided for the safe side
        if (validity == UndistortionMap::Validity::all) {
            const Box& box = map_.bounds(i, j);
            range = view_.footprint(box);
            if (!range)
                return;
            if (const auto uniform = view_.uniform_radiance(*range)) {
                tile.constant = static_cast<float>(*uniform - view_.background());
                return;
            }
            blurred = view_.smallest_defocus(box) >= least_defocus();
        }
        if (sampling_.kind == SampleKind::point)
            sample_points(i, j, range, tile);
        else if (blurred && std::isfinite(sampling_.exact_lens_from_px))
            sample_blurred_boxes(i, j, range, tile);
        else
            sample_boxes(i, j, range, tile);
    }

private:
    // c at which the blur radius is exact_lens_from_px.
    double least_defocus() const {
        const Intrinsics& intrinsics = map_.projector().camera().intrinsics;
        return sampling_.exact_lens_from_px /
               (std::min(intrinsics.fx, intrinsics.fy) * view_.aperture().radius_mm);
    }

    double lens_average(const std::optional<MappedPoint>& point,
                        const std::optional<CellRange>& tile_range) {
        if (!point)
            return view_.background();
        const auto range = tile_range ? tile_range : view_.footprint(point_box(point->x));
        return range ? lens_average_.at(point->x, *range) : view_.background();
    }

    void sample_points(int i, int j, const std::optional<CellRange>& range, Tile& tile) {
        map_.sample(i, j, tile_px * sampling_.k, points_);
        tile.values.reserve(points_.size());
        for (const auto& point : points_)
            tile.values.push_back(
                static_cast<float>(lens_average(point, range) - view_.background()));
    }

    void sample_blurred_boxes(int i, int j, const std::optional<CellRange>& range, Tile& tile) {
        const int n = tile_px * sampling_.k;
        map_.sample(i, j, 2 * n, points_);
        tile.values.resize(static_cast<std::size_t>(n * n));
        for (int y = 0; y < n; ++y)
            for (int x = 0; x < n; ++x) {
                double sum = 0.0;
                for (int q = 0; q < 4; ++q) {
                    const int index = (2 * y + q / 2) * 2 * n + 2 * x + q % 2;
                    sum += lens_average(points_[static_cast<std::size_t>(index)], range);
                }
                tile.values[static_cast<std::size_t>(y * n + x)] =
                    static_cast<float>(sum / 4.0 - view_.background());
            }
    }

    void sample_boxes(int i, int j, const std::optional<CellRange>& tile_range, Tile& tile) {
        map_.sample(i, j, tile_px * sampling_.k, points_);
        tile.values.reserve(points_.size());
        for (const auto& point : points_) {
            double value = view_.background();
            if (point) {
                const Eigen::Matrix2d sides = point->jacobian / sampling_.k;
                const auto range =
                    tile_range ? tile_range : view_.footprint(parallelogram_box(point->x, sides));
                if (range)
                    value = coverage_.over(point->x, sides, *range);
            }
            tile.values.push_back(static_cast<float>(value - view_.background()));
        }
    }

    const MarkerView& view_;
    const UndistortionMap& map_;
    const Sampling& sampling_;
    LensAverage lens_average_;
    CellCoverage coverage_;
    std::vector<std::optional<MappedPoint>> points_;
};

TileSamples::TileSamples(const MarkerView& view, const UndistortionMap& map, const cv::Rect& tiles,
                         const Sampling& sampling)
    : tiles_(tiles), sampling_(sampling), table_(static_cast<std::size_t>(tiles.area())) {
    tbb::parallel_for(tbb::blocked_range<int>(tiles.y, tiles.br().y), [&](const auto& rows) {
        Evaluator evaluator(view, map, sampling_);
        for (int j = rows.begin(); j < rows.end(); ++j)
            for (int i = tiles_.x; i < tiles_.br().x; ++i)
                evaluator.evaluate(i, j, tile(i, j));
    });
}

std::optional<float> TileSamples::constant(const cv::Rect& part) const {
    const float value = tile(part.x, part.y).constant;
    for (int j = part.y; j < part.br().y; ++j)
        for (int i = part.x; i < part.br().x; ++i)
            if (!tile(i, j).values.empty() || tile(i, j).constant != value)
                return std::nullopt;
    return value;
}

void TileSamples::copy(const cv::Rect& samples, cv::Mat& out) const {
    const int n = tile_px * sampling_.k;
    const int left = tiles_.x * n, top = tiles_.y * n;
    for (int y = samples.y; y < samples.br().y; ++y) {
        const int j = tiles_.y + (y - top) / n, row = (y - top) % n;
        float* to = out.ptr<float>(y - samples.y);
        for (int x = samples.x; x < samples.br().x;) {
            const Tile& from = tile(tiles_.x + (x - left) / n, j);
            const int column = (x - left) % n;
            const int count = std::min(n - column, samples.br().x - x);
            if (from.values.empty())
                std::fill_n(to, count, from.constant);
            else
                std::copy_n(&from.values[static_cast<std::size_t>(row * n + column)], count, to);
            to += count;
            x += count;
        }
    }
}

cv::Rect TileSamples::tiles_off_background() const {
    cv::Rect result;
    for (int j = tiles_.y; j < tiles_.br().y; ++j)
        for (int i = tiles_.x; i < tiles_.br().x; ++i)
            if (!tile(i, j).values.empty() || tile(i, j).constant != 0.0f)
                result = result.empty() ? cv::Rect(i, j, 1, 1) : result | cv::Rect(i, j, 1, 1);
    return result;
}

void TileSamples::pixel_means(int i, int j, cv::Mat means) const {
    const Tile& from = tile(i, j);
    means.setTo(from.constant);
    if (from.values.empty())
        return;
    const int k = sampling_.k, n = tile_px * k;
    for (int p = 0; p < tile_px * tile_px; ++p) {
        const int left = p % tile_px * k, top = p / tile_px * k;
        float sum = 0.0f;
        for (int q = 0; q < k * k; ++q)
            sum += from.values[static_cast<std::size_t>((top + q / k) * n + left + q % k)];
        means.at<float>(p / tile_px, p % tile_px) = sum / static_cast<float>(k * k);
    }
}

}  // namespace etalon
