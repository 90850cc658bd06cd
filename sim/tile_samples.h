// The aperture average sampled over part of the sensor, k x k values a pixel, tile by tile: a tile
// whose rays all meet the same radiance is one number, and most such tiles are found many at a time
// by the bounds of their group.
//
// Values are differences from the background, so that what lies outside is zero.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "sim/marker_view.h"
#include "sim/render_plan.h"
#include "sim/sampling.h"
#include "sim/undistortion_map.h"

namespace etalon {

class TileSamples {
public:
    // Evaluates every tile of `tiles` (tile indices, within the map's), in parallel; the result
    // does not depend on the number of threads.
    // `all_refined`: no tile is taken as uniform, whatever the bounds say (to test the bounds).
    TileSamples(const MarkerView& view, const UndistortionMap& map, const cv::Rect& tiles,
                const Sampling& sampling, bool all_refined = false);

    const cv::Rect& tiles() const { return tiles_; }
    int k() const { return sampling_.k; }

    // Whether a tile has values of its own; if not, the one value that it has throughout; if so,
    // its (4 k)^2 values row by row.
    bool refined(int i, int j) const { return values_[index(i, j)] != nullptr; }
    float constant_value(int i, int j) const { return constants_[index(i, j)]; }
    const float* values(int i, int j) const { return values_[index(i, j)]; }

    // How the refined tiles were sampled, most tiles first.
    const std::vector<TileUse>& used() const { return used_; }

    // Whether every tile of this part has one and the same value, and which.
    std::optional<float> constant(const cv::Rect& part) const;

    // Copies the samples of a part of the sensor into `out` (CV_32FC1 of its size); coordinates in
    // samples, sample (0, 0) the first of pixel (0, 0).
    void copy(const cv::Rect& samples, cv::Mat& out) const;

    // The smallest rectangle of tiles that holds every tile different from the background.
    const cv::Rect& tiles_off_background() const { return off_background_; }

    // Average of each pixel of the tile, into `means` (CV_32FC1, 4 x 4).
    void pixel_means(int i, int j, cv::Mat means) const;

private:
    // Tiles that are evaluated together by one thread, with the memory of their values.
    struct Block {
        int level, i, j;
        std::vector<float> store;
        std::vector<TileUse> used;
    };
    class Search;

    cv::Rect find_tiles_off_background() const;

    std::size_t index(int i, int j) const {
        return static_cast<std::size_t>(j - tiles_.y) * static_cast<std::size_t>(tiles_.width) +
               static_cast<std::size_t>(i - tiles_.x);
    }

    cv::Rect tiles_;
    Sampling sampling_;
    std::vector<float> constants_;
    std::vector<const float*> values_;  // into a block's store; null: constant
    std::vector<Block> blocks_;
    std::vector<TileUse> used_;
    cv::Rect off_background_;
};

}  // namespace etalon
