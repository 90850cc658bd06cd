// Convolution of samples that are mostly constant (sim/tiles/tile_map.h) with small kernels. Where
// a kernel sees one constant the result is that constant times the kernel's energy, found in O(1);
// only the rest is summed.
#pragma once

#include <cstddef>
#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "sim/tiles/filter_simd.h"
#include "sim/tiles/tile_map.h"

namespace etalon {

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
    int margin_x() const { return margin_x_; }
    int margin_y() const { return margin_y_; }

    // For windows that begin margin_x() outputs to the left and reach_y() samples above.
    MirroredKernel view() const;
    // Distance of two phases in such a window.
    int phase_stride() const;

private:
    int k_, reach_x_, reach_y_, margin_x_, margin_y_;
    double energy_;
    std::vector<std::ptrdiff_t> left_, right_;
    std::vector<float> weights_;
    std::vector<int> first_pairs_;
};

// Adds the convolution to `out` (CV_32FC1), whose first pixel is the output `region.tl()`. The
// tile's side must be a multiple of the kernel's k. In parallel; the same bytes for any number of
// threads. Costs nothing where the field is zero.
void add_filtered(const SampleField& field, const FilterKernel& kernel, const cv::Rect& region,
                  cv::Mat& out);

// The same of the region's rows that lie in one band, for outputs that are still in the caches.
void add_filtered_band(const SampleField& field, const FilterKernel& kernel, const cv::Rect& region,
                       const cv::Rect& band, cv::Mat& out);

// Calls the work, in parallel, for each of the bands of rows in which add_filtered() works: parts
// of the region.
void for_each_band(const cv::Rect& region, const std::function<void(const cv::Rect&)>& work);

}  // namespace etalon
