#include "sim/tail_pyramid.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <array>

#include "sim/lagrange.h"

namespace etalon {
namespace {

// Weights of six samples for a point a quarter of a step before the fourth.
std::array<float, 6> quarter_weights() {
    std::array<float, 6> weights;
    for (std::size_t n = 0; n < 6; ++n)
        weights[n] = static_cast<float>(lagrange6(2.75 - static_cast<double>(n)));
    return weights;
}

// Adds the coarse values, interpolated up by two, to `fine`, whose first value has the indices
// `to.tl()`. `from` must hold three more coarse squares around.
void add_refined(const cv::Mat& coarse, const cv::Rect& from, const cv::Rect& to, cv::Mat& fine) {
    const std::array<float, 6> weights = quarter_weights();
    tbb::parallel_for(tbb::blocked_range<int>(to.y, to.br().y, 16), [&](const auto& range) {
        std::vector<float> row(static_cast<std::size_t>(from.width));
        for (int y = range.begin(); y < range.end(); ++y) {
            const bool odd = y & 1;
            const float* rows[6];
            for (int n = 0; n < 6; ++n)
                rows[n] = coarse.ptr<float>((y >> 1) + (odd ? 3 - n : n - 3) - from.y);
            sum_six_rows(rows, weights.data(), from.width, row.data());
            add_interpolated(row.data() - from.x, weights.data(), to.x, to.br().x,
                             fine.ptr<float>(y - to.y));
        }
    });
}

// The squares of each grid whose sums the target pixels need, by shift; the finer grids' values are
// interpolated between them.
std::vector<cv::Rect> target_squares(const cv::Rect& pixels, int top) {
    constexpr int margin = 3;  // of the interpolation
    std::vector<cv::Rect> targets{pixels};
    for (int shift = 1; shift <= top; ++shift)
        targets.push_back(grown(cells_of(targets.back(), 2), margin, margin));
    return targets;
}

// The rings of one camera's tail that a reach takes.
struct Rings {
    const ImageFilter& filter;
    int count = 0;

    Rings(const ImageFilter& image_filter, double reach_px) : filter(image_filter) {
        while (filter.radius_held(count) < reach_px &&
               filter.level_shift(count) < SquareCorners::most_shift)
            ++count;
    }

    int first() const { return filter.level_shift(0); }
    int top() const { return filter.level_shift(count - 1); }
    const FilterKernel& on(int shift) const { return filter.ring(std::max(0, shift - first())); }

    // The squares that the targets' sums see.
    std::vector<cv::Rect> sources(const std::vector<cv::Rect>& targets) const {
        std::vector<cv::Rect> result;
        for (const cv::Rect& target : targets) {
            const FilterKernel& ring = on(static_cast<int>(result.size()));
            result.push_back(grown(target, ring.margin_x(), ring.margin_y()));
        }
        return result;
    }
};

}  // namespace

TailPyramid::TailPyramid(const ImageFilter& filter, const Projector& projector)
    : filter_(filter), corners_(projector) {}

void TailPyramid::add(const TileSamples& samples, const MarkerView& marker, double reach_px,
                      const cv::Rect& region, cv::Mat& difference) const {
    constexpr int finest_outside = 3;  // shift of the squares outside the samples
    constexpr double most_px = 1e5;
    const Rings rings(filter_, std::min(reach_px, most_px));
    if (rings.count == 0)
        return;
    const int reach = static_cast<int>(std::ceil(std::min(reach_px, most_px)));
    TailSources sources(samples, marker, corners_, grown(region, reach, reach));
    const cv::Rect pixels = grown(sources.pixels(), reach, reach) & region;
    if (sources.pixels().empty() || pixels.empty())
        return;
    const auto targets = target_squares(pixels, std::max(rings.top(), finest_outside));
    sources.average(rings.sources(targets));
    cv::Mat coarser;
    for (int shift = rings.top(); shift >= 0; --shift) {
        const auto level = static_cast<std::size_t>(shift);
        const cv::Rect& target = targets[level];
        cv::Mat sums =
            shift == 0 ? difference(target - region.tl()) : cv::Mat::zeros(target.size(), CV_32FC1);
        if (shift >= rings.first())
            add_filtered(sources.field(shift), rings.on(shift), target, sums);
        if (shift < rings.top())
            add_refined(coarser, targets[level + 1], target, sums);
        coarser = sums;
    }
}

}  // namespace etalon
