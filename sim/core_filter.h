// Filtering of samples that are mostly constant: fields in which a tile is one value throughout, or
// a square of values, and their convolution with small kernels. Where a kernel sees one constant
// the result is that constant times the kernel's energy, found in O(1); only the rest is summed.
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

#include "sim/filter_simd.h"

namespace etalon {

class TileSamples;

// a / b rounded down; b > 0.
int floor_div(int a, int b);

// The cells of `size` pixels that hold a pixel of the rectangle.
cv::Rect cells_of(const cv::Rect& pixels, int size);

// The rectangle with margins of x and y on both sides.
cv::Rect grown(const cv::Rect& rect, int x, int y);

// A kernel ready for add_filtered(): output p is the sum over the samples k p - reach ... k p + k -
// 1 + reach of each direction. It must equal its mirror image from left to right (the pattern of
// every lens here does); immutable.
class FilterKernel {
public:
    // `weights`: CV_64FC1, k + 2 reach_y rows and k + 2 reach_x columns. Weights in the corners
    // are left out, up to 1e-5 and 3e-4 of the kernel in sum; the middle has them instead.
    FilterKernel(int k, const cv::Mat& weights);

    int k() const { return k_; }
    int reach_x() const { return reach_x_; }
    int reach_y() const { return reach_y_; }
    double energy() const { return energy_; }  // sum of the weights
    // How far beyond an output's own samples it looks, in outputs.
    int margin_x() const { return (reach_x_ + k_ - 1) / k_; }
    int margin_y() const { return (reach_y_ + k_ - 1) / k_; }

    // For windows that begin margin_x() outputs to the left and reach_y() samples above.
    MirroredKernel view() const;
    // Distance of two phases in such a window.
    int phase_stride() const;

private:
    int k_, reach_x_, reach_y_;
    double energy_;
    std::vector<std::ptrdiff_t> left_, right_;
    std::vector<float> weights_;
    std::vector<int> first_pairs_;
};

// One value for each tile of a grid, zero outside, and where it is the same throughout.
class TileMap {
public:
    // All zero and none of them refined.
    explicit TileMap(const cv::Rect& tiles);

    // A refined tile has finer values elsewhere and counts as different from its neighbours.
    void set(int i, int j, float value, bool refined = false) {
        values_[index(i, j)] = value;
        refined_[index(i, j)] = refined;
    }
    // After the last set(): prepares is_constant().
    void finish();

    const cv::Rect& tiles() const { return tiles_; }

    // Whether a part is surely one value throughout (a part to the right of or below a different
    // tile may be missed). O(1).
    bool is_constant(const cv::Rect& part) const;

    float at(const cv::Point& tile) const {
        return tiles_.contains(tile) ? values_[index(tile.x, tile.y)] : 0.0f;
    }
    // The values from a tile on, to the end of its row.
    const float* from(const cv::Point& tile) const { return &values_[index(tile.x, tile.y)]; }

    std::size_t index(int i, int j) const {
        return static_cast<std::size_t>(j - tiles_.y) * static_cast<std::size_t>(tiles_.width) +
               static_cast<std::size_t>(i - tiles_.x);
    }

private:
    cv::Rect tiles_;
    std::vector<float> values_;
    std::vector<unsigned char> refined_;
    cv::Rect counted_;         // the tiles and one more on each side
    std::vector<int> counts_;  // summed-area table over them of tiles that are refined or unlike
                               // their left or upper neighbour
};

// Samples on a regular grid in square tiles. Where `finer` holds a pointer for a tile, by
// TileMap::index(), `side` x `side` samples stand row by row `offset` behind it; elsewhere the tile
// is the map's value throughout. With the side 1 the map says it all. The map and `finer` must
// outlive it.
struct SampleField {
    const TileMap& map;
    int side = 1;
    const std::vector<const float*>* finer = nullptr;
    std::ptrdiff_t offset = 0;

    // Nothing where the tile is constant.
    const float* samples(const cv::Point& tile) const {
        if (!finer || !map.tiles().contains(tile))
            return nullptr;
        const float* first = (*finer)[map.index(tile.x, tile.y)];
        return first ? first + offset : nullptr;
    }
};

// Adds the convolution to `out` (CV_32FC1), whose first pixel is the output `region.tl()`. The
// tile's side must be a multiple of the kernel's k. In parallel; the same bytes for any number of
// threads. Costs nothing where the field is zero.
void add_filtered(const SampleField& field, const FilterKernel& kernel, const cv::Rect& region,
                  cv::Mat& out);

// Adds the core's part of every pixel of the region to `difference` (CV_32FC1 of its size).
void add_core(const TileSamples& samples, const FilterKernel& core, const cv::Rect& region,
              cv::Mat& difference);

}  // namespace etalon
