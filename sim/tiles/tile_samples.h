// The aperture average sampled over part of the sensor, k x k values a pixel, tile by tile: a tile
// whose rays all meet the same radiance is one number. Values are differences from the background.
#pragma once

#include "sim/tiles/edge_group.h"
#include "sim/tiles/render_plan.h"
#include "sim/tiles/sampling.h"

namespace etalon {

class TileSamples {
public:
    // Evaluates every tile of `tiles` (tile indices, within the map's), in parallel; the result
    // does not depend on the number of threads. `all_refined`: no tile is taken as uniform.
    TileSamples(const MarkerView& view, const UndistortionMap& map, const cv::Rect& tiles,
                const Sampling& sampling, bool all_refined = false);

    // All that were asked for.
    const cv::Rect& tiles() const { return tiles_; }
    int k() const { return sampling_.k; }

    // The tiles that may differ from the background: each one's average. Refined ones also have
    // their 2 x 2 quarters' averages and behind them the (4 k)^2 samples, if any.
    const TileMap& map() const { return map_; }
    static constexpr std::ptrdiff_t samples_offset = 4;
    // From where on the (4 k)^2 averages before any spread begin.
    std::ptrdiff_t unspread_offset() const {
        return samples_offset + (sampling_.kind == SampleKind::pixel ? tile_px * tile_px : 0);
    }
    // All of it for add_filtered().
    SampleField field() const {
        return {map_, side(), samples_offset, TileDetail::samples,
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

    void find_edges(const Search& search, const MarkerView& view, const UndistortionMap& map);
    void leave_out_samples();
    void average_edges(Block& block);
    void sample(const Search& search, const MarkerView& view, const UndistortionMap& map);
    void sum_up_blocks();

    cv::Rect tiles_;
    Sampling sampling_;
    TileMap map_;
    std::vector<Block> blocks_;
    CellTable<GroupKind> groups_;          // with edges only
    std::vector<const EdgeGroup*> edges_;  // by rows
    std::vector<TileUse> used_;
    cv::Rect off_background_;
};

}  // namespace etalon
