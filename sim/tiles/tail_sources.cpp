#include "sim/tiles/tail_sources.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "sim/scene/marker_view.h"

namespace etalon {
namespace {

constexpr int tile_shift = 2;    // a tile is one square
constexpr int square_shift = 3;  // the finest grid outside the sampled tiles

cv::Rect scaled(const cv::Rect& rect, int factor) {
    return {rect.x * factor, rect.y * factor, rect.width * factor, rect.height * factor};
}

bool contains(const cv::Rect& outer, const cv::Rect& inner) {
    return (outer & inner) == inner;
}

// The squares of twice the side that lie inside.
cv::Rect halves_inside(const cv::Rect& rect) {
    const cv::Point first((rect.x + 1) >> 1, (rect.y + 1) >> 1);
    const cv::Point end(rect.br().x >> 1, rect.br().y >> 1);
    return first.x < end.x && first.y < end.y ? cv::Rect(first, end) : cv::Rect();
}

// Each of the averages of two pairs of values, one below the other.
void average_pairs(const float* upper, const float* lower, int count, float* averages) {
    for (int i = 0; i < count; ++i)
        averages[i] = 0.25f * (upper[2 * i] + upper[2 * i + 1] + lower[2 * i] + lower[2 * i + 1]);
}

// The pixels that hold the marker's image, blur included.
cv::Rect marker_box(const MarkerView& marker, const Intrinsics& intrinsics,
                    const std::vector<Eigen::Vector2d>& outline, const cv::Rect& limit) {
    constexpr double bulge_px = 16.0;  // between two of its points, at most
    const BlurRange blur = blur_over_marker(marker, intrinsics);
    return pixels_around(outline, Eigen::Array2d::Constant(2.0 * blur.largest_px + bulge_px),
                         limit);
}

}  // namespace

std::optional<SquareCorners::Corners> SquareCorners::of(int shift, int i, int j) const {
    Corners result;
    for (int q = 0; q < 4; ++q) {
        auto& x = result[static_cast<std::size_t>(q)];
        x = point_at(shift, {i + q % 2, j + q / 2});
        if (!x.allFinite())
            return std::nullopt;
    }
    return result;
}

Eigen::Vector2d SquareCorners::compute(int shift, const cv::Point& node) const {
    const double g = std::ldexp(1.0, shift);
    const auto x = projector_.unproject({g * node.x - 0.5, g * node.y - 0.5});
    return x ? *x : Eigen::Vector2d::Constant(std::nan(""));
}

Eigen::Vector2d SquareCorners::point_at(int shift, const cv::Point& node) const {
    const Table& known = table(shift);
    const cv::Point at(floor_div(node.x, part_side), floor_div(node.y, part_side));
    if (!known.parts.contains(at))
        return compute(shift, node);
    Part& part = known.of_parts[(at.y - known.parts.y) * known.parts.width + at.x - known.parts.x];
    const cv::Point first = part_side * at;
    std::call_once(part.once, [&] {
        for (int n = 0; n < part_side * part_side; ++n)
            part.points.push_back(compute(shift, first + cv::Point(n % part_side, n / part_side)));
    });
    return part.points[static_cast<std::size_t>((node.y - first.y) * part_side + node.x - first.x)];
}

const SquareCorners::Table& SquareCorners::table(int shift) const {
    constexpr int margin = 32;  // squares beyond the image that rings and interpolation see
    Table& result = tables_[static_cast<std::size_t>(shift)];
    std::call_once(result.once, [&] {
        result.parts = cells_of(grown(cells_of(pixels_, 1 << shift), margin, margin), part_side);
        result.of_parts = std::make_unique<Part[]>(static_cast<std::size_t>(result.parts.area()));
    });
    return result;
}

cv::Rect source_pixels(const TileSamples& samples, const MarkerView& marker,
                       const Intrinsics& intrinsics, const std::vector<Eigen::Vector2d>& outline,
                       const cv::Rect& limit) {
    const cv::Rect sampled = scaled(samples.tiles_off_background(), tile_px);
    const cv::Rect box = marker_box(marker, intrinsics, outline, limit);
    if (contains(scaled(samples.tiles(), tile_px), box))
        return sampled & limit;
    return (sampled.empty() ? box : sampled | box) & limit;
}

TailSources::TailSources(const TileSamples& samples, const MarkerView& marker,
                         const SquareCorners& corners, const cv::Rect& pixels)
    : samples_(samples), marker_(marker), corners_(corners), pixels_(pixels) {}

void TailSources::average(const std::vector<cv::Rect>& needed, int finest) {
    squares_.assign(needed.size(), TileMap());
    // Tiles are needed where the finer grids are, too, and wherever there are samples.
    take_tiles(grown(needed[tile_shift], 2, 2) | samples_.tiles());
    if (finest == 0)
        average_pixels();
    average_squares(needed);
    fill_tiles_outside();
    for (TileMap& squares : squares_)
        squares.finish();
}

void TailSources::take_tiles(const cv::Rect& needed_tiles) {
    TileMap& tiles = squares_[tile_shift];
    const TileMap& sampled = samples_.map();
    tiles = TileMap(cells_of(pixels_, tile_px) & needed_tiles);
    tiles.copy(sampled);
    values_ = std::make_unique_for_overwrite<const float*[]>(
        static_cast<std::size_t>(tiles.tiles().area()));
    const cv::Rect both = tiles.tiles() & sampled.tiles();
    for (int j = both.y; j < both.br().y; ++j)
        std::copy_n(samples_.all_values() + sampled.index(both.x, j), both.width,
                    &values_[tiles.index(both.x, j)]);
}

void TailSources::average_pixels() {
    constexpr int side = tile_px, pixels = side * side;
    const TileMap& tiles = squares_[tile_shift];
    const auto count = static_cast<std::size_t>(tiles.tiles().area());
    pixel_averages_.resize(static_cast<std::size_t>(pixels) * tiles.refined_count());
    pixel_values_ = std::make_unique_for_overwrite<const float*[]>(count);
    float* next = pixel_averages_.data();
    for (std::size_t n = 0; n < count; ++n)
        if (tiles.refined(n)) {
            average_parts(values_[n] + samples_.unspread_offset(), samples_.k() * tile_px, side,
                          next);
            pixel_values_[n] = next;
            next += pixels;
        }
}

// Each square from the four finer ones where all of them are known, otherwise through the lens.
void TailSources::average_squares(const std::vector<cv::Rect>& needed) {
    for (std::size_t n = square_shift; n < needed.size(); ++n) {
        const int shift = static_cast<int>(n);
        const TileMap& finer = squares_[n - 1];
        const cv::Rect known = shift == square_shift ? samples_.tiles() : needed[n - 1];
        const cv::Rect cells = cells_of(pixels_, 1 << shift) & needed[n];
        const cv::Rect within = halves_inside(finer.tiles() & known) & cells;
        squares_[n] = TileMap(cells);
        tbb::parallel_for(tbb::blocked_range<int>(cells.y, cells.br().y), [&](const auto& rows) {
            LensAverage lens_average(marker_);
            const auto mean = [&](int i, int j) {
                const int x = 2 * i, y = 2 * j;
                return contains(known, {x, y, 2, 2})
                           ? 0.25f * (finer.at({x, y}) + finer.at({x + 1, y}) +
                                      finer.at({x, y + 1}) + finer.at({x + 1, y + 1}))
                           : lens_mean(shift, i, j, lens_average);
            };
            for (int j = rows.begin(); j < rows.end(); ++j) {
                const bool inside = j >= within.y && j < within.br().y;
                const int from = inside ? within.x : cells.br().x;
                const int to = inside ? within.br().x : cells.br().x;
                for (int i = cells.x; i < from; ++i)
                    squares_[n].set(i, j, mean(i, j));
                if (from < to)
                    average_pairs(finer.from({2 * from, 2 * j}), finer.from({2 * from, 2 * j + 1}),
                                  to - from, squares_[n].from({from, j}));
                for (int i = to; i < cells.br().x; ++i)
                    squares_[n].set(i, j, mean(i, j));
            }
        });
    }
}

void TailSources::fill_tiles_outside() {
    TileMap& tiles = squares_[tile_shift];
    const cv::Rect all = tiles.tiles();
    if (contains(samples_.tiles(), all))
        return;
    for (int j = all.y; j < all.br().y; ++j)
        for (int i = all.x; i < all.br().x; ++i)
            if (!samples_.tiles().contains({i, j}))
                tiles.set(i, j, squares_[square_shift].at({i >> 1, j >> 1}));
}

// Of 4 x 4 lens averages; their points are interpolated between the square's corners.
float TailSources::lens_mean(int shift, int i, int j, LensAverage& lens_average) const {
    const auto corners = corners_.of(shift, i, j);
    if (!corners)
        return 0.0f;
    const auto& [a, b, c, d] = *corners;
    const Box box{a.cwiseMin(b).cwiseMin(c).cwiseMin(d), a.cwiseMax(b).cwiseMax(c).cwiseMax(d)};
    const auto range = marker_.footprint(box);
    if (!range)
        return 0.0f;
    if (const auto uniform = marker_.uniform_radiance(*range))
        return static_cast<float>(*uniform - marker_.background());
    double sum = 0.0;
    for (int q = 0; q < 16; ++q) {
        const double s = (q % 4 + 0.5) / 4.0, t = (q / 4 + 0.5) / 4.0;
        const Eigen::Vector2d x = (1 - t) * ((1 - s) * a + s * b) + t * ((1 - s) * c + s * d);
        if (const auto seen = marker_.footprint({x, x}))
            sum += lens_average.at(x, *seen) - marker_.background();
    }
    return static_cast<float>(sum / 16.0);
}

SampleField TailSources::field(int shift) const {
    if (shift >= tile_shift)
        return {squares_[static_cast<std::size_t>(shift)]};
    if (shift == 0)
        return {squares_[tile_shift], tile_px, pixel_values_.get()};
    return {squares_[tile_shift], tile_px / 2, values_.get()};
}

}  // namespace etalon
