// The aperture average sampled over part of the sensor, k x k values a pixel, tile by tile: a tile
// whose rays all meet the same radiance is one number, and most such tiles are found many at a time
// by the bounds of their group.
//
// Values are differences from the background, so that what lies outside is zero.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "sim/scene/marker_view.h"
#include "sim/tiles/edge_group.h"
#include "sim/tiles/render_plan.h"
#include "sim/tiles/sampling.h"
#include "sim/tiles/tile_map.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

class TileSamples {
public:
    // Evaluates every tile of `tiles` (tile indices, within the map's), in parallel; the result
    // does not depend on the number of threads.
    // `all_refined`: no tile is taken as uniform, whatever the bounds say (to test the bounds).
    TileSamples(const MarkerView& view, const UndistortionMap& map, const cv::Rect& tiles,
                const Sampling& sampling, bool all_refined = false);

    // All that were asked for.
    const cv::Rect& tiles() const { return tiles_; }
    int k() const { return sampling_.k; }

    // The tiles among which are all that differ from the background: each tile's average. Refined
    // ones have values of their own, the others the one value.
    const TileMap& map() const { return map_; }
    // Of a tile of the map its (4 k)^2 values, row by row; null: there are none.
    const float* values(int i, int j) const {
        return map_.detail(i, j) == TileDetail::samples ? values_[map_.index(i, j)] + samples_offset
                                                        : nullptr;
    }
    // Of the refined tiles, by the map's index: the averages of the quarters, 2 x 2 of them, and
    // behind them the samples.
    static constexpr std::ptrdiff_t samples_offset = 4;
    const float* const* all_values() const { return values_.get(); }
    // From where on the (4 k)^2 averages before any spread begin.
    std::ptrdiff_t unspread_offset() const {
        return samples_offset + (sampling_.kind == SampleKind::pixel ? tile_px * tile_px : 0);
    }
    // All of it for add_filtered().
    SampleField field() const {
        return {map_,
                side(),
                values_.get(),
                samples_offset,
                TileDetail::samples,
                sampling_.edges ? &groups_ : nullptr};
    }
    // Adds what the pixels of a band of the region see of the edges that are not in the field.
    void add_edges(const cv::Rect& region, const cv::Rect& band, cv::Mat& pixels) const;

    // The smallest rectangle of tiles that holds every tile different from the background.
    const cv::Rect& tiles_off_background() const { return off_background_; }

    // How the refined tiles were sampled, most tiles first.
    const std::vector<TileUse>& used() const { return used_; }

private:
    // Tiles that are evaluated together by one thread, with the memory of their values.
    struct Block {
        int i, j;  // of UndistortionMap::block_level
        std::unique_ptr<float[]> store;
        std::vector<TileUse> used;
        cv::Rect off_background;
        std::vector<EdgeGroup> edges;
        std::unique_ptr<float[]> edge_store;  // of those without samples
    };
    class Search;
    int side() const { return tile_px * k(); }

    // Tiles that are one value other than the background.
    struct Uniform {
        cv::Rect tiles;
        float value;
    };

    void find_edges(const Search& search, const MarkerView& view, const UndistortionMap& map);
    void leave_out_samples();
    void average_edges(Block& block);
    void sample(const Search& search, const MarkerView& view, const UndistortionMap& map);
    void sum_up_blocks();

    cv::Rect tiles_;
    Sampling sampling_;
    TileMap map_;
    std::unique_ptr<const float*[]> values_;  // of the refined tiles, into a block's store
    std::vector<Block> blocks_;
    GroupMap groups_;                      // with edges only
    std::vector<const EdgeGroup*> edges_;  // by rows
    std::vector<TileUse> used_;
    cv::Rect off_background_;
};

}  // namespace etalon
