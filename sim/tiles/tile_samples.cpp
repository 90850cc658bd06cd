#include "sim/tiles/tile_samples.h"

#include <tbb/parallel_for_each.h>

#include "sim/tiles/filter_simd.h"
#include "sim/tiles/tile_evaluator.h"

namespace etalon {
namespace {

// Blocks of 16 x 16 tiles: few enough to share out, each long enough to be worth a task.
constexpr int block_level = UndistortionMap::block_level;

void count(std::vector<TileUse>& used, const TileUse& one) {
    for (TileUse& use : used)
        if (use.method == one.method && use.points_per_pixel_side == one.points_per_pixel_side &&
            use.lens_points == one.lens_points) {
            use.tiles += one.tiles;
            return;
        }
    used.push_back(one);
}

void include(const cv::Rect& part, cv::Rect& all) {
    all = all.empty() ? part : all | part;
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
    Search(const TileSamples& samples, const MarkerView& view, const UndistortionMap& map,
           bool all_refined)
        : asked_(samples.tiles_), view_(view), map_(map), all_refined_(all_refined) {
        // Disks reach beyond their tile: by less than this part of its half side of 2 px, whatever
        // its shape.
        margin_ = 1.25 * samples.sampling_.disk_radius_px / (0.5 * tile_px);
    }

    // Calls found(i, j, range) for every group of `to_level` that is not uniform and
    // uniform(tiles, value) for the uniform ones, of any level, that are not background. A range
    // is only given for tiles (to_level 0) that are not at the border of the valid region.
    // `around`: what footprint() says of a group that holds this one, if that is known.
    template <class Found, class MeetsUniform>
    void descend(int level, int i, int j, int to_level, const Found& found,
                 const MeetsUniform& uniform,
                 const std::optional<CellRange>& around = std::nullopt) const {
        const cv::Rect tiles = tiles_of_group(level, i, j) & asked_;
        if (tiles.empty())
            return;
        const auto& [validity, all_bounds] = map_.group(level, i, j);
        if (validity == UndistortionMap::Validity::none)
            return;
        std::optional<CellRange> range;
        const Box bounds = grown(all_bounds);
        if (validity == UndistortionMap::Validity::all) {
            range = around && has_few_lines(*around) ? view_.narrowed(*around, bounds)
                                                     : view_.footprint(bounds);
            if (!all_refined_) {
                if (!range)
                    return;  // background
                if (const auto radiance = view_.uniform_radiance(*range)) {
                    const auto value = static_cast<float>(*radiance - view_.background());
                    if (value != 0.0f)
                        uniform(tiles, value);
                    return;
                }
            }
            if (level == 0 && !range)
                range = CellRange{-1, -1, -1, -1};
        } else if (!all_refined_ && !view_.footprint(bounds)) {
            return;  // what has a ray sees the background, as what has none
        }
        if (level == to_level)
            return found(i, j, range);
        constexpr int side = UndistortionMap::group_side;
        const cv::Rect below = cv::Rect(side * i, side * j, side, side) & map_.groups(level - 1);
        map_.prefetch(level - 1, below);
        for (int y = below.y; y < below.br().y; ++y)
            for (int x = below.x; x < below.br().x; ++x)
                descend(level - 1, x, y, to_level, found, uniform, range);
    }

private:
    // So few that asking each of them takes less time than the corners of a box.
    static bool has_few_lines(const CellRange& range) {
        constexpr int few = 3;
        return range.last_column - range.first_column <= few &&
               range.last_row - range.first_row <= few;
    }

    Box grown(const Box& box) const {
        const Eigen::Vector2d margin = margin_ * box.half();
        return {box.low - margin, box.high + margin};
    }

    cv::Rect asked_;
    const MarkerView& view_;
    const UndistortionMap& map_;
    bool all_refined_;
    double margin_;
};

TileSamples::TileSamples(const MarkerView& view, const UndistortionMap& map, const cv::Rect& tiles,
                         const Sampling& sampling, bool all_refined)
    : tiles_(tiles), sampling_(sampling) {
    const Search search(*this, view, map, all_refined);
    const int top = map.levels() - 1;
    const cv::Rect groups = map.groups(top);
    std::vector<Uniform> uniform;
    cv::Rect mapped;
    for (int j = groups.y; j < groups.br().y; ++j)
        for (int i = groups.x; i < groups.br().x; ++i)
            search.descend(
                top, i, j, block_level,
                [&](int x, int y, const auto&) {
                    blocks_.push_back({x, y, nullptr, {}, {}});
                    include(tiles_of_group(block_level, x, y) & tiles_, mapped);
                },
                [&](const cv::Rect& part, float value) {
                    uniform.push_back({part, value});
                    include(part, mapped);
                    include(part, off_background_);
                });
    map_ = TileMap(mapped);
    values_ =
        std::make_unique_for_overwrite<const float*[]>(static_cast<std::size_t>(mapped.area()));
    for (const auto& [part, value] : uniform)
        map_.fill(part, value);
    sample(search, view, map);
    map_.finish();
    sum_up_blocks();
}

void TileSamples::sample(const Search& search, const MarkerView& view, const UndistortionMap& map) {
    const TilePositionsOf positions(sampling_);
    constexpr std::size_t quarters = 4;
    const std::size_t samples = static_cast<std::size_t>(side() * side());
    struct Tile {
        int i, j;
        std::optional<CellRange> range;
    };
    tbb::parallel_for_each(blocks_, [&](Block& block) {
        std::vector<Tile> refined;
        search.descend(
            block_level, block.i, block.j, 0,
            [&](int i, int j, const std::optional<CellRange>& range) {
                map.prefetch_polynomial(i, j);
                refined.push_back({i, j, range});
            },
            [&](const cv::Rect& part, float value) {
                map_.fill(part, value);
                include(part, block.off_background);
            });
        if (refined.empty())
            return;
        TileEvaluator evaluator(view, map, sampling_, positions);
        block.store.reset(new float[refined.size() * (samples + quarters)]);
        float* values = block.store.get();
        for (const auto& [i, j, range] : refined) {
            count(block.used, evaluator.evaluate(i, j, range, values));
            float* q = values + samples;
            average_parts(values, side(), 2, q);
            map_.set(i, j, 0.25f * ((q[0] + q[1]) + (q[2] + q[3])), true);
            include({i, j, 1, 1}, block.off_background);
            values_[map_.index(i, j)] = values;
            values += samples + quarters;
        }
    });
}

void TileSamples::sum_up_blocks() {
    for (const Block& block : blocks_) {
        for (const TileUse& use : block.used)
            count(used_, use);
        if (!block.off_background.empty())
            include(block.off_background, off_background_);
    }
    std::sort(used_.begin(), used_.end(),
              [](const TileUse& a, const TileUse& b) { return a.tiles > b.tiles; });
}

}  // namespace etalon
