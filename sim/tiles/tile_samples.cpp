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
        // What reaches beyond a tile or a group, in units of a tile's half side of 2 px, whatever
        // its shape.
        constexpr double of_shape = 1.25 / (0.5 * tile_px);
        const Sampling& sampling = samples.sampling_;
        margin_ = of_shape * std::max(sampling.disk_radius_px, sampling.wedge_reach_px);
        if (const EdgeTable* edges = sampling.edges)
            group_margin_ = of_shape * edges->reach_px();
    }

    // Groups that have no samples are passed over.
    void leave_out_edges(const CellTable<GroupKind>& groups) { groups_ = &groups; }

    // Calls found(i, j, range) for every group of `to_level` that is not uniform and
    // uniform(tiles, value) for the uniform ones, of any level, that are not background. No range:
    // the border of the valid region. `around`: the range of a group that holds this one.
    template <class Found, class MeetsUniform>
    void descend(int level, int i, int j, int to_level, const Found& found,
                 const MeetsUniform& uniform,
                 const std::optional<CellRange>& around = std::nullopt) const {
        const cv::Rect tiles = tiles_of_group(level, i, j) & asked_;
        if (tiles.empty() ||
            (level == EdgeGroup::level && groups_ && groups_->find(i, j) == GroupKind::edge_only))
            return;
        const UndistortionMap::Group& group = map_.group(level, i, j);
        if (group.validity == UndistortionMap::Validity::none)
            return;
        std::optional<CellRange> range;
        const Box bounds = grown(group.bounds, level);
        if (group.validity == UndistortionMap::Validity::all) {
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
        for_each_cell(below, [&](int x, int y) {
            descend(level - 1, x, y, to_level, found, uniform, range);
        });
    }

private:
    // So few that asking each of them takes less time than the corners of a box.
    static bool has_few_lines(const CellRange& range) {
        constexpr int few = 3;
        return range.last_column - range.first_column <= few &&
               range.last_row - range.first_row <= few;
    }

    Box grown(const Box& box, int level) const {
        const double of_half = std::ldexp(margin_ + (level > 0 ? group_margin_ : 0.0), -2 * level);
        const Eigen::Vector2d margin = of_half * box.half();
        return {box.low - margin, box.high + margin};
    }

    cv::Rect asked_;
    const MarkerView& view_;
    const UndistortionMap& map_;
    bool all_refined_;
    double margin_, group_margin_ = 0.0;
    const CellTable<GroupKind>* groups_ = nullptr;
};

TileSamples::TileSamples(const MarkerView& view, const UndistortionMap& map, const cv::Rect& tiles,
                         const Sampling& sampling, bool all_refined)
    : tiles_(tiles), sampling_(sampling) {
    Search search(*this, view, map, all_refined);
    const int top = map.levels() - 1;
    std::vector<std::pair<cv::Rect, float>> uniform;  // tiles and their value
    cv::Rect mapped;
    for_each_cell(map.groups(top), [&](int i, int j) {
        search.descend(
            top, i, j, block_level,
            [&](int x, int y, const auto&) {
                blocks_.push_back({x, y});
                include(tiles_of_group(block_level, x, y) & tiles_, mapped);
            },
            [&](const cv::Rect& part, float value) {
                uniform.emplace_back(part, value);
                include(part, mapped);
                include(part, off_background_);
            });
    });
    map_ = TileMap(mapped);
    for (const auto& [part, value] : uniform)
        map_.fill(part, value);
    if (sampling_.edges) {
        find_edges(search, view, map);
        search.leave_out_edges(groups_);
    }
    sample(search, view, map);
    map_.finish();
    sum_up_blocks();
}

void TileSamples::find_edges(const Search& search, const MarkerView& view,
                             const UndistortionMap& map) {
    groups_ = CellTable<GroupKind>(cells_of(map_.tiles(), UndistortionMap::group_side));
    tbb::parallel_for_each(blocks_, [&](Block& block) {
        search.descend(
            block_level, block.i, block.j, EdgeGroup::level,
            [&](int i, int j, const std::optional<CellRange>& range) {
                groups_.at(i, j) = GroupKind::sampled;
                const auto edge = range ? one_edge(view, *range) : std::nullopt;
                if (!edge)
                    return;
                if (const auto group =
                        edge_group(view, map, i, j, *edge, *sampling_.edges, sampling_.edge_gray)) {
                    groups_.at(i, j) = GroupKind::edge;
                    block.edges.push_back(*group);
                }
            },
            [](const cv::Rect&, float) {});
    });
    leave_out_samples();
}

// Only groups that are sampled, beside whose kernels reach less than a group's side, look at other
// groups' samples.
void TileSamples::leave_out_samples() {
    for (const Block& block : blocks_)
        for (const EdgeGroup& group : block.edges) {
            bool is_needed = false;
            for_each_cell({group.i - 1, group.j - 1, 3, 3}, [&](int i, int j) {
                is_needed |= groups_.find(i, j) == GroupKind::sampled;
            });
            if (!is_needed)
                groups_.at(group.i, group.j) = GroupKind::edge_only;
            edges_.push_back(&group);
        }
    std::ranges::sort(edges_, {},
                      [](const EdgeGroup* edge) { return std::pair(edge->j, edge->i); });
}

// Of those tiles that have no samples.
void TileSamples::average_edges(Block& block) {
    constexpr int side = UndistortionMap::group_side, quarters = 2 * side;
    std::size_t groups = 0;
    for (const EdgeGroup& group : block.edges)
        groups += groups_.at(group.i, group.j) == GroupKind::edge_only;
    if (groups == 0)
        return;
    constexpr std::size_t values_of_group = quarters * quarters;
    block.edge_store.reset(new float[groups * values_of_group]);
    float* values = block.edge_store.get();
    for (const EdgeGroup& group : block.edges) {
        if (groups_.at(group.i, group.j) != GroupKind::edge_only)
            continue;
        float averages[values_of_group];
        edge_averages(group, averages);
        const cv::Rect tiles = tiles_of_group(EdgeGroup::level, group.i, group.j) & tiles_;
        include(tiles, block.off_background);
        for_each_cell(tiles, [&](int i, int j) {
            const float* upper =
                averages + 2 * (quarters * (j - side * group.j) + i - side * group.i);
            const float* lower = upper + quarters;
            const float q[samples_offset] = {upper[0], upper[1], lower[0], lower[1]};
            std::copy_n(q, samples_offset, values);
            const bool even = q[0] == q[1] && q[2] == q[3] && q[0] == q[2];
            map_.set(i, j, 0.25f * ((q[0] + q[1]) + (q[2] + q[3])),
                     even ? TileDetail::none : TileDetail::quarters, values);
            values += samples_offset;
        });
        count(block.used, {RenderMethod::edge_table, 1, 1, tiles.area()});
    }
}

void TileSamples::add_edges(const cv::Rect& region, const cv::Rect& band, cv::Mat& pixels) const {
    constexpr int side = EdgeGroup::side_px;
    const auto from = std::partition_point(edges_.begin(), edges_.end(), [&](const EdgeGroup* e) {
        return side * (e->j + 1) <= band.y;
    });
    EdgeProfile profile;
    for (auto at = from; at != edges_.end() && side * (*at)->j < band.br().y; ++at) {
        const EdgeGroup& group = **at;
        const cv::Rect all(side * group.i, side * group.j, side, side), part = all & band & region;
        if (part.empty())
            continue;
        sampling_.edges->profile(group.blur, group.diagonal, profile);
        const auto energy = static_cast<float>(sampling_.edges->energy());
        const int first = part.y - all.y, end = part.br().y - all.y;
        float* to = pixels.ptr<float>(part.y - region.y) + (part.x - region.x);
        if (part.width == side) {
            add_edge(group, profile, energy, first, end, to,
                     static_cast<std::ptrdiff_t>(pixels.step1()));
            continue;
        }
        float whole[side * side] = {};
        add_edge(group, profile, energy, first, end, whole, side);
        for (int y = 0; y < part.height; ++y)
            for (int x = 0; x < part.width; ++x)
                pixels.at<float>(part.y - region.y + y, part.x - region.x + x) +=
                    whole[side * y + part.x - all.x + x];
    }
}

void TileSamples::sample(const Search& search, const MarkerView& view, const UndistortionMap& map) {
    const TilePositionsOf positions(sampling_);
    const std::size_t stride =
        static_cast<std::size_t>(unspread_offset() + side() * side());  // of tiles
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
        average_edges(block);
        if (refined.empty())
            return;
        TileEvaluator evaluator(view, map, sampling_, positions);
        block.store.reset(new float[refined.size() * stride]);
        float* values = block.store.get();
        for (const auto& [i, j, range] : refined) {
            float* q = values;
            count(block.used, evaluator.evaluate(i, j, range, values + samples_offset));
            filter_loops().average_parts(values + unspread_offset(), side(), 2, q);
            map_.set(i, j, 0.25f * ((q[0] + q[1]) + (q[2] + q[3])), TileDetail::samples, values);
            include({i, j, 1, 1}, block.off_background);
            values += stride;
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
    std::ranges::sort(used_, std::greater(), &TileUse::tiles);
}

}  // namespace etalon
