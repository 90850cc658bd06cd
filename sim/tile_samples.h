// The aperture average sampled over part of the sensor, k x k values a pixel, tile by tile: a tile
// whose rays all meet the same radiance is one number, and most such tiles are found many at a time
// by the bounds of their group.
//
// Values are differences from the background, so that what lies outside is zero.
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "sim/marker_view.h"
#include "sim/render_plan.h"
#include "sim/sampling.h"
#include "sim/tile_map.h"
#include "sim/undistortion_map.h"

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

    // The tiles among which are all that differ from the background. Refined ones have values of
    // their own, the others the one value that the map has.
    const TileMap& map() const { return map_; }
    // The (4 k)^2 values of a tile of the map, row by row; null: not refined.
    const float* values(int i, int j) const { return values_[map_.index(i, j)]; }
    // All of it for add_filtered().
    SampleField field() const { return {map_, UndistortionMap::tile_px * k(), &values_}; }

    // How the refined tiles were sampled, most tiles first.
    const std::vector<TileUse>& used() const { return used_; }

private:
    // Tiles that are evaluated together by one thread, with the memory of their values.
    struct Block {
        int level, i, j;
        std::unique_ptr<float[]> store;
        std::vector<TileUse> used;
    };
    class Search;
    // Tiles that are one value other than the background.
    struct Uniform {
        cv::Rect tiles;
        float value;
    };

    void sample(const Search& search, const MarkerView& view, const UndistortionMap& map);
    void count_uses();

    cv::Rect tiles_;
    Sampling sampling_;
    TileMap map_;
    std::vector<const float*> values_;  // by the map's index, into a block's store
    std::vector<Block> blocks_;
    std::vector<TileUse> used_;
};

}  // namespace etalon
