#include "sim/tile_samples.h"

#include <tbb/parallel_for_each.h>

#include "sim/tile_evaluator.h"

namespace etalon {
namespace {

constexpr int tile_px = UndistortionMap::tile_px;
// Blocks of 16 x 16 tiles: few enough to share out, each long enough to be worth a task.
constexpr int block_level = 2;

void count(std::vector<TileUse>& used, const TileUse& one) {
    for (TileUse& use : used)
        if (use.method == one.method && use.points_per_pixel_side == one.points_per_pixel_side &&
            use.lens_points == one.lens_points) {
            use.tiles += one.tiles;
            return;
        }
    used.push_back(one);
}

// The tiles of a group.
cv::Rect tiles_of_group(int level, int i, int j) {
    const int side = 1 << (2 * level);
    static_assert(UndistortionMap::group_side == 4);
    return {i * side, j * side, side, side};
}

}  // namespace

// Goes from the largest groups of tiles down to those that the marker's edges may cross.
class TileSamples::Search {
public:
    Search(TileSamples& samples, const MarkerView& view, const UndistortionMap& map,
           bool all_refined)
        : samples_(samples), view_(view), map_(map), all_refined_(all_refined) {
        // Disks reach beyond their tile: by less than this part of its half side of 2 px, whatever
        // its shape.
        margin_ = 1.25 * samples.sampling_.disk_radius_px / (0.5 * tile_px);
    }

    // Calls found(i, j, range) for every group of `to_level` that is not uniform; uniform ones get
    // their value. A range is only given for tiles (to_level 0) that are not at the border of the
    // valid region.
    template <class Found>
    void descend(int level, int i, int j, int to_level, const Found& found) const {
        const cv::Rect tiles = tiles_of_group(level, i, j) & samples_.tiles_;
        const auto validity = map_.validity(level, i, j);
        if (tiles.empty() || validity == UndistortionMap::Validity::none)
            return;
        std::optional<CellRange> range;
        const Box bounds = grown(map_.bounds(level, i, j));
        if (validity == UndistortionMap::Validity::all) {
            range = view_.footprint(bounds);
            if (!all_refined_ && is_uniform(tiles, range))
                return;
            if (level == 0 && !range)
                range = CellRange{-1, -1, -1, -1};
        } else if (!all_refined_ && !view_.footprint(bounds)) {
            return;  // what has a ray sees the background, as what has none
        }
        if (level == to_level)
            return found(i, j, range);
        constexpr int side = UndistortionMap::group_side;
        const cv::Rect below = cv::Rect(side * i, side * j, side, side) & map_.groups(level - 1);
        for (int y = below.y; y < below.br().y; ++y)
            for (int x = below.x; x < below.br().x; ++x)
                descend(level - 1, x, y, to_level, found);
    }

private:
    Box grown(const Box& box) const {
        const Eigen::Vector2d margin = margin_ * box.half();
        return {box.low - margin, box.high + margin};
    }

    // Fills the tiles with the one radiance that they show, if it is one.
    bool is_uniform(const cv::Rect& tiles, const std::optional<CellRange>& range) const {
        if (!range)
            return true;  // background
        const auto radiance = view_.uniform_radiance(*range);
        if (!radiance)
            return false;
        const auto value = static_cast<float>(*radiance - view_.background());
        if (value != 0.0f)
            for (int j = tiles.y; j < tiles.br().y; ++j)
                std::fill_n(&samples_.constants_[samples_.index(tiles.x, j)], tiles.width, value);
        return true;
    }

    TileSamples& samples_;
    const MarkerView& view_;
    const UndistortionMap& map_;
    bool all_refined_;
    double margin_;
};

TileSamples::TileSamples(const MarkerView& view, const UndistortionMap& map, const cv::Rect& tiles,
                         const Sampling& sampling, bool all_refined)
    : tiles_(tiles),
      sampling_(sampling),
      constants_(static_cast<std::size_t>(tiles.area()), 0.0f),
      values_(static_cast<std::size_t>(tiles.area()), nullptr) {
    const Search search(*this, view, map, all_refined);
    const int top = map.levels() - 1, level = std::min(block_level, top);
    const cv::Rect groups = map.groups(top);
    for (int j = groups.y; j < groups.br().y; ++j)
        for (int i = groups.x; i < groups.br().x; ++i)
            search.descend(top, i, j, level, [&](int x, int y, const auto&) {
                blocks_.push_back({level, x, y, {}, {}});
            });

    const TilePositionsOf positions(sampling_);
    const auto n = static_cast<std::size_t>(tile_px * sampling_.k);
    tbb::parallel_for_each(blocks_, [&](Block& block) {
        TileEvaluator evaluator(view, map, sampling_, positions);
        std::vector<std::size_t> refined;
        search.descend(block.level, block.i, block.j, 0,
                       [&](int i, int j, const std::optional<CellRange>& range) {
                           refined.push_back(index(i, j));
                           const std::size_t before = block.store.size();
                           block.store.resize(before + n * n);
                           count(block.used, evaluator.evaluate(i, j, range, &block.store[before]));
                       });
        for (std::size_t q = 0; q < refined.size(); ++q)
            values_[refined[q]] = &block.store[q * n * n];
    });
    for (const Block& block : blocks_)
        for (const TileUse& use : block.used)
            count(used_, use);
    std::sort(used_.begin(), used_.end(),
              [](const TileUse& a, const TileUse& b) { return a.tiles > b.tiles; });
    off_background_ = find_tiles_off_background();
}

std::optional<float> TileSamples::constant(const cv::Rect& part) const {
    const float value = constant_value(part.x, part.y);
    for (int j = part.y; j < part.br().y; ++j)
        for (int i = part.x; i < part.br().x; ++i)
            if (refined(i, j) || constant_value(i, j) != value)
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
            const int i = tiles_.x + (x - left) / n;
            const int column = (x - left) % n;
            const int count = std::min(n - column, samples.br().x - x);
            if (refined(i, j))
                std::copy_n(values(i, j) + row * n + column, count, to);
            else
                std::fill_n(to, count, constant_value(i, j));
            to += count;
            x += count;
        }
    }
}

cv::Rect TileSamples::find_tiles_off_background() const {
    cv::Rect result;
    for (int j = tiles_.y; j < tiles_.br().y; ++j)
        for (int i = tiles_.x; i < tiles_.br().x; ++i)
            if (refined(i, j) || constant_value(i, j) != 0.0f)
                result = result.empty() ? cv::Rect(i, j, 1, 1) : result | cv::Rect(i, j, 1, 1);
    return result;
}

void TileSamples::pixel_means(int i, int j, cv::Mat means) const {
    means.setTo(constant_value(i, j));
    if (!refined(i, j))
        return;
    const float* from = values(i, j);
    const int k = sampling_.k, n = tile_px * k;
    for (int p = 0; p < tile_px * tile_px; ++p) {
        const int left = p % tile_px * k, top = p / tile_px * k;
        float sum = 0.0f;
        for (int q = 0; q < k * k; ++q)
            sum += from[(top + q / k) * n + left + q % k];
        means.at<float>(p / tile_px, p % tile_px) = sum / static_cast<float>(k * k);
    }
}

}  // namespace etalon
