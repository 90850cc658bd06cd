// The inner loops of the image filter, vectorised with Google Highway. Each result is one sum in a
// fixed order.
#pragma once

#include <cstddef>
#include <optional>

namespace etalon {

// A kernel with its mirror image, on rows stored phase by phase: sample k x + q of a row lies at q
// * phase_stride + x. Two samples with the same weight are added first.
struct MirroredKernel {
    static constexpr int rows_at_once = 4;  // output rows

    int k;                        // samples per output step
    int rows;                     // of weights
    int pairs;                    // per row
    const std::ptrdiff_t* left;   // offsets of the pair's samples within a row, for output 0
    const std::ptrdiff_t* right;  //
    const float* weights;         // rows x pairs, with (rows_at_once - 1) k rows of zeros before
                                  // and behind
    const int* first_pairs;       // of each window row that rows_at_once outputs see: the pairs
                                  // before have no weight in any of these
};

struct FilterLoops {
    // out(y, x) += the sum of kernel row q and pair p of weight * (left sample + right sample) in
    // the window's row k y + q. `width` a multiple of 16, `height` of rows_at_once.
    void (*add_convolved)(const MirroredKernel& kernel, const float* window,
                          std::ptrdiff_t window_stride, int width, int height, float* out,
                          std::ptrdiff_t out_stride);

    // to[x] = the sum of weights[n] * from[n * stride + x].
    void (*sum_eight_rows)(const float* from, std::ptrdiff_t stride, const float weights[8],
                           int width, float* to);

    // to[x] = the sum of weights[n] * from[2 x + n], for `count` of them.
    void (*thin_row)(const float* from, const float weights[8], int count, float* to);

    // One value in `columns` places of each phase and row, and in up to 15 more behind them.
    void (*fill_phases)(float value, int columns, int k, int rows, std::ptrdiff_t phase_stride,
                        std::ptrdiff_t window_stride, float* to);

    // Four outputs' samples of each row, 4 k values, phase by phase:
    // to[q * phase_stride + x] = from[k x + q].
    void (*split_phases)(const float* from, int k, int rows, std::ptrdiff_t phase_stride,
                         std::ptrdiff_t window_stride, float* to);

    // The averages of the parts x parts squares of side x side values, row by row; side a multiple
    // of 4 and of `parts`, at most 192.
    void (*average_parts)(const float* values, int side, int parts, float* averages);

    // out(y, x) += value.
    void (*add_constant)(float value, int width, int height, float* out, std::ptrdiff_t out_stride);

    // even[x] = sum of weights[n] * rows[n][x] over the first six of seven rows; odd[x] the mirror
    // image, of the last six.
    void (*sum_row_pair)(const float* const rows[7], const float weights[6], int width, float* even,
                         float* odd);

    // Interpolation up by two, for the fine samples first ... last - 1: fine sample 2 i lies a
    // quarter of a step before coarse sample i, 2 i + 1 a quarter behind it: the sum of weights[n]
    // * coarse[i - 3 + n], for odd ones its mirror image. With a `base` writes the sum and the base
    // to out[f - first], without one adds the sum.
    void (*put_interpolated)(const float* coarse, const float weights[6], int first, int last,
                             std::optional<float> base, float* out);

    // Writes one value, past the caches if these would not hold the image anyway.
    void (*fill_row)(float value, std::ptrdiff_t count, bool past_caches, float* out);

    // Linear interpolation up by 2^shift >= 8: pixels first ... last - 1 between the coarse
    // samples, of which sample i stands in the middle of the pixels from 2^shift i on. Adds to
    // `out`, or writes, past the caches if these would not hold the image anyway.
    void (*put_ramps)(const float* coarse, int shift, int first, int last, bool add,
                      bool past_caches, float* out);
};

// For the best instruction set of this machine.
const FilterLoops& filter_loops();

}  // namespace etalon
