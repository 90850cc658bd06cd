// From samples of a tile and a margin around it on another grid to the samples on the frame's own:
// from a coarse one by the 6-point Lagrange kernel (sim/psf/lagrange.h), for tiles that are blurred
// enough; from one of twice as many places a side by a low-pass, for sharp tiles.
#pragma once

#include "sim/tiles/sampling.h"

namespace etalon {

// Immutable, safe from every thread.
class TileInterpolation {
public:
    // Samples beyond the tile on each side: the kernels need three, blocks of 4 x 4 are what the
    // tile kernel makes.
    static constexpr int margin = 4;
    // Samples a side of the other grid, margins included.
    static int side(int k);

    // A sample between 2 n others, their middle at 0, is the sum of low_pass[i] of those i + 1/2
    // steps away on both sides. With c = cos and s = sin of pi f times the step, the transfer is
    // c^3 (1 + 3/2 s^2 + 15/8 s^4).
    static constexpr std::array<double, 4> low_pass{525.0 / 1024, 35.0 / 1024, -63.0 / 1024,
                                                    15.0 / 1024};

    // From from_k to k samples per pixel side. `kind` of the result: the interpolant's values at
    // the places (point, disk) or its averages over the k x k parts of each pixel (box), from_k < 2
    // k; disk and from_k = 2 k: thinned out.
    TileInterpolation(int from_k, int k, SampleKind kind);

    // `from`: side(from_k)^2 values; `values`: (4 k)^2, both row by row. `scratch`: memory to use.
    void interpolate(const float* from, std::vector<float>& scratch, float* values) const;

private:
    // Of a sample, along one axis: the other grid's samples from `first` on by their weights.
    static constexpr int taps = 8;
    struct Weights {
        int first;
        float of[taps];
    };

    static Weights interpolating(double place, double half, int side);
    static Weights thinning(int sample);
    void along_rows(const float* from, std::size_t rows, float* to) const;
    void along_columns(const float* from, std::size_t columns, float* to) const;

    std::size_t side_;
    bool is_thinning_;
    std::vector<Weights> weights_;
};

}  // namespace etalon
