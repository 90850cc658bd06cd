// Convolution of samples that are mostly constant (sim/tiles/tile_map.h) with small kernels: where
// a kernel sees one constant, in O(1).
#pragma once

#include <functional>

#include "sim/tiles/filter_simd.h"
#include "sim/tiles/tile_map.h"

namespace etalon {

// A kernel ready for add_filtered(): output p is the sum over the samples k p - reach ... k p + k -
// 1 + reach of each direction. It must equal its mirror image from left to right.
struct FilterKernel {
    // `weights`: CV_64FC1, k + 2 reach_y rows and k + 2 reach_x columns. Weights in the corners
    // are left out, up to 1e-5 and 3e-4 of the kernel in sum; the middle has them instead.
    FilterKernel(int k, const cv::Mat& weights);

    int k, reach_x, reach_y;
    int margin_x, margin_y;  // how far beyond an output's own samples it looks, in outputs
    double energy;           // sum of the weights

    // For windows that begin margin_x outputs to the left and reach_y samples above.
    MirroredKernel view() const;
    // Distance of two phases in such a window.
    int phase_stride() const;

private:
    std::vector<std::ptrdiff_t> left_, right_;
    std::vector<float> weights_;
    std::vector<int> first_pairs_;
};

// Adds the convolution to `out` (CV_32FC1), whose first pixel is the output `region.tl()`, in the
// rows that lie in one band of the region. The tile's side must be a multiple of the kernel's k.
// Costs nothing where the field is zero.
void add_filtered(const SampleField& field, const FilterKernel& kernel, const cv::Rect& region,
                  const cv::Rect& band, cv::Mat& out);

// Calls the work, in parallel, for the bands of rows that add_filtered() takes: parts of the
// region. The same bytes for any number of threads.
void for_each_band(const cv::Rect& region, const std::function<void(const cv::Rect&)>& work);

}  // namespace etalon
