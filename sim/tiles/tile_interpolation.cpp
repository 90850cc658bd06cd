#include "sim/tiles/tile_interpolation.h"

#include "sim/tiles/filter_simd.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

int TileInterpolation::side(int k) {
    return tile_px * k + 2 * margin;
}

// Places are counted in samples of the other grid from the first one of the margin.
TileInterpolation::TileInterpolation(int from_k, int k, SampleKind kind)
    : side_(static_cast<std::size_t>(side(from_k))),
      is_thinning_(kind == SampleKind::disk && from_k > k) {
    const double step = static_cast<double>(from_k) / k;
    const double half = kind == SampleKind::box ? 0.5 * step : 0.0;
    for (int x = 0; x < tile_px * k; ++x)
        weights_.push_back(
            is_thinning_ ? thinning(x)
                         : interpolating((x + 0.5) * step - 0.5 + margin, half, side(from_k)));
}

// An average's part, 2 half, is narrower than two samples: at most 8 samples have a weight.
TileInterpolation::Weights TileInterpolation::interpolating(double place, double half, int side) {
    const int first = static_cast<int>(std::ceil(place - half - 3.0));
    Weights weights{std::min(first, side - taps), {}};  // all of them there
    for (int tap = 0; tap < taps; ++tap) {
        const double t = place - (weights.first + tap);
        const double weight =
            half > 0.0 ? lagrange6_integral(t - half, t + half) / (2.0 * half) : lagrange6(t);
        weights.of[tap] = static_cast<float>(weight);
    }
    return weights;
}

TileInterpolation::Weights TileInterpolation::thinning(int sample) {
    constexpr int half = taps / 2;
    Weights weights{2 * sample + margin + 1 - half, {}};
    for (int tap = 0; tap < half; ++tap)
        weights.of[half + tap] = weights.of[half - 1 - tap] =
            static_cast<float>(low_pass[static_cast<std::size_t>(tap)]);
    return weights;
}

void TileInterpolation::along_rows(const float* from, std::size_t rows, float* to) const {
    if (is_thinning_) {
        const Weights& first = weights_.front();
        for (std::size_t y = 0; y < rows; ++y)
            filter_loops().thin_row(from + y * side_ + first.first, first.of,
                                    static_cast<int>(weights_.size()), to + y * weights_.size());
        return;
    }
    for (std::size_t y = 0; y < rows; ++y, from += side_)
        for (const Weights& weights : weights_) {
            const float *v = from + weights.first, *w = weights.of;
            *to++ = ((w[0] * v[0] + w[1] * v[1]) + (w[2] * v[2] + w[3] * v[3])) +
                    ((w[4] * v[4] + w[5] * v[5]) + (w[6] * v[6] + w[7] * v[7]));
        }
}

void TileInterpolation::along_columns(const float* from, std::size_t n, float* to) const {
    for (const Weights& weights : weights_) {
        filter_loops().sum_eight_rows(from + n * static_cast<std::size_t>(weights.first),
                                      static_cast<std::ptrdiff_t>(n), weights.of,
                                      static_cast<int>(n), to);
        to += n;
    }
}

// The direction in which whole rows are summed takes the larger part.
void TileInterpolation::interpolate(const float* from, std::vector<float>& scratch,
                                    float* values) const {
    const std::size_t n = weights_.size();
    scratch.resize(side_ * n);
    if (n < side_) {
        along_columns(from, side_, scratch.data());
        along_rows(scratch.data(), n, values);
    } else {
        along_rows(from, side_, scratch.data());
        along_columns(scratch.data(), n, values);
    }
}

}  // namespace etalon
