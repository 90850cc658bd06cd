// From samples of a tile and a margin around it on a coarse grid to the samples on the frame's own
// grid, by the 6-point Lagrange kernel (sim/lagrange.h). For tiles that are blurred enough: there
// the interpolant of few exact values is as good as many of them, and costs a fraction.
#pragma once

#include <vector>

#include "sim/sampling.h"

namespace etalon {

// Immutable, safe from every thread.
class TileInterpolation {
public:
    // Coarse samples beyond the tile on each side: the kernel needs three, blocks of 4 x 4 are what
    // the tile kernel makes.
    static constexpr int margin = 4;
    // Coarse samples a side, margins included.
    static int coarse_side(int coarse_k);

    // From coarse_k to k samples per pixel side, coarse_k < k; `kind` of the result: values at the
    // places (point) or the interpolant's averages over the k x k parts of each pixel (box).
    TileInterpolation(int coarse_k, int k, SampleKind kind);

    // `coarse`: coarse_side^2 values; `values`: (4 k)^2, both row by row. `scratch`: memory to use.
    void interpolate(const float* coarse, std::vector<float>& scratch, float* values) const;

private:
    // Of a sample, along one axis: the coarse samples from `first` on by their weights.
    static constexpr int taps = 8;
    struct Weights {
        int first;
        float of[taps];
    };

    int coarse_side_;
    std::vector<Weights> weights_;
};

}  // namespace etalon
