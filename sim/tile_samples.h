// The aperture average sampled over part of the sensor, k x k values a pixel, tile by tile: a tile
// whose rays all meet the same radiance is one number and costs nothing more.
//
// Values are differences from the background, so that what lies outside is zero.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "sim/image_filter.h"
#include "sim/marker_view.h"
#include "sim/undistortion_map.h"

namespace etalon {

// How to sample: see RenderPlan.
struct Sampling {
    int k = 1;
    SampleKind kind = SampleKind::box;
    // Box samples: tiles blurred by more than this take the mean of 2 x 2 exact lens averages per
    // box instead of the exact area at some lens points.
    double exact_lens_from_px = std::numeric_limits<double>::infinity();
    int lens_rings = 1, lens_spokes = 0;
};

class TileSamples {
public:
    // Evaluates every tile of `tiles` (tile indices, within the map's), in parallel; the result
    // does not depend on the number of threads. Throws NumericalError as MarkerView::footprint.
    TileSamples(const MarkerView& view, const UndistortionMap& map, const cv::Rect& tiles,
                const Sampling& sampling);

    const cv::Rect& tiles() const { return tiles_; }
    int k() const { return sampling_.k; }

    // Whether a tile has values of its own; if not, the one value that it has throughout; if so,
    // its (4 k)^2 values row by row.
    bool refined(int i, int j) const { return !tile(i, j).values.empty(); }
    float constant_value(int i, int j) const { return tile(i, j).constant; }
    const float* values(int i, int j) const { return tile(i, j).values.data(); }

    // Whether every tile of this part has one and the same value, and which.
    std::optional<float> constant(const cv::Rect& part) const;

    // Copies the samples of a part of the sensor into `out` (CV_32FC1 of its size); coordinates in
    // samples, sample (0, 0) the first of pixel (0, 0).
    void copy(const cv::Rect& samples, cv::Mat& out) const;

    // The smallest rectangle of tiles that holds every tile different from the background.
    cv::Rect tiles_off_background() const;

    // Average of each pixel of the tile, into `means` (CV_32FC1, 4 x 4).
    void pixel_means(int i, int j, cv::Mat means) const;

private:
    struct Tile {
        float constant = 0.0f;
        std::vector<float> values;  // (4 k)^2 row by row; empty: constant
    };
    class Evaluator;

    Tile& tile(int i, int j) {
        return table_[static_cast<std::size_t>((j - tiles_.y) * tiles_.width + i - tiles_.x)];
    }
    const Tile& tile(int i, int j) const { return const_cast<TileSamples*>(this)->tile(i, j); }

    cv::Rect tiles_;
    Sampling sampling_;
    std::vector<Tile> table_;
};

}  // namespace etalon
