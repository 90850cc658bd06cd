#include "sim/tile_interpolation.h"

#include <algorithm>
#include <cmath>

#include "sim/lagrange.h"
#include "sim/undistortion_map.h"

namespace etalon {
namespace {

constexpr int tile_px = UndistortionMap::tile_px;

}  // namespace

int TileInterpolation::coarse_side(int coarse_k) {
    return tile_px * coarse_k + 2 * margin;
}

// Places are counted in coarse samples from the first one of the margin. An average's part is
// narrower than a coarse sample: at most 7 samples have a weight.
TileInterpolation::TileInterpolation(int coarse_k, int k, SampleKind kind)
    : coarse_side_(coarse_side(coarse_k)) {
    const double step = static_cast<double>(coarse_k) / k;
    const double half = kind == SampleKind::box ? 0.5 * step : 0.0;
    for (int x = 0; x < tile_px * k; ++x) {
        const double place = (x + 0.5) * step - 0.5 + margin;
        const int first = static_cast<int>(std::ceil(place - half - 3.0));
        Weights weights{std::min(first, coarse_side_ - taps), {}};  // all of them there
        for (int tap = 0; tap < taps; ++tap) {
            const double t = place - (weights.first + tap);
            const double weight =
                half > 0.0 ? lagrange6_integral(t - half, t + half) / step : lagrange6(t);
            weights.of[tap] = static_cast<float>(weight);
        }
        weights_.push_back(weights);
    }
}

// Along the rows, then along the columns, where whole rows are summed.
void TileInterpolation::interpolate(const float* coarse, std::vector<float>& scratch,
                                    float* values) const {
    const std::size_t n = weights_.size(), side = static_cast<std::size_t>(coarse_side_);
    scratch.resize(side * n);
    for (std::size_t y = 0; y < side; ++y)
        for (std::size_t x = 0; x < n; ++x) {
            const float* from = coarse + side * y + weights_[x].first;
            const float* w = weights_[x].of;
            scratch[n * y + x] =
                ((w[0] * from[0] + w[1] * from[1]) + (w[2] * from[2] + w[3] * from[3])) +
                ((w[4] * from[4] + w[5] * from[5]) + (w[6] * from[6] + w[7] * from[7]));
        }
    for (std::size_t y = 0; y < n; ++y) {
        const float* from = &scratch[n * static_cast<std::size_t>(weights_[y].first)];
        const float* w = weights_[y].of;
        float* to = values + n * y;
        for (std::size_t x = 0; x < n; ++x)
            to[x] = ((w[0] * from[x] + w[1] * from[n + x]) +
                     (w[2] * from[2 * n + x] + w[3] * from[3 * n + x])) +
                    ((w[4] * from[4 * n + x] + w[5] * from[5 * n + x]) +
                     (w[6] * from[6 * n + x] + w[7] * from[7 * n + x]));
    }
}

}  // namespace etalon
