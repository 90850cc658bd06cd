#include "sim/tiles/tail_pyramid.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <array>

#include "sim/psf/lagrange.h"

namespace etalon {
namespace {

// Weights of six samples for a point a quarter of a step before the fourth.
std::array<float, 6> quarter_weights() {
    std::array<float, 6> weights;
    for (std::size_t n = 0; n < 6; ++n)
        weights[n] = static_cast<float>(lagrange6(2.75 - static_cast<double>(n)));
    return weights;
}

// Adds the coarse values, interpolated up by two, to a band of rows of `fine`, whose first value
// has the indices `to.tl()`; writes them and the background where there is one. `from` must hold
// three more coarse squares around.
void add_refined(const cv::Mat& coarse, const cv::Rect& from, const cv::Rect& to,
                 const cv::Rect& band, std::optional<float> background, cv::Mat& fine) {
    const std::array<float, 6> weights = quarter_weights();
    const auto width = static_cast<std::size_t>(from.width);
    std::vector<float> pair(2 * width);  // the fine rows 2 i and 2 i + 1
    for (int y = band.y; y < band.br().y; ++y) {
        if (y == band.y || y % 2 == 0) {
            const float* rows[7];
            for (int n = 0; n < 7; ++n)
                rows[n] = coarse.ptr<float>((y >> 1) + n - 3 - from.y);
            sum_row_pair(rows, weights.data(), from.width, pair.data(), pair.data() + width);
        }
        const float* row = pair.data() + (y & 1 ? width : 0) - from.x;
        float* to_row = fine.ptr<float>(y - to.y);
        if (background)
            set_interpolated(row, weights.data(), to.x, to.br().x, *background, to_row);
        else
            add_interpolated(row, weights.data(), to.x, to.br().x, to_row);
    }
}

int smooth_shift(const ImageFilter& filter) {
    return filter.first_ring() + 3;
}

// What is written where. Beside the marker every grid is interpolated from the next coarser one. A
// pixel 6 of the smooth grid's squares away from it sees no ring of a finer grid, and so little
// curvature that straight lines between the smooth grid's sums are off by less than 0.06 lambda N
// gray over the square's side in px: beside a half-plane the tail is 26 lambda N / r gray at the
// distance r, and its second derivative 2 / r^2 of that.
struct Targets {
    cv::Rect reached, beside;       // pixels
    std::vector<cv::Rect> squares;  // by shift, pixels (beside) first: where sums are needed
    int smooth;                     // shift

    Targets(const cv::Rect& marker, const cv::Rect& reached_pixels, int smooth_shift, int top)
        : reached(reached_pixels), beside(reached_pixels), smooth(smooth_shift) {
        constexpr int margin = 3;  // of the interpolation
        if (top >= smooth)
            beside &= grown(marker, 6 << smooth, 6 << smooth);
        if (beside.empty())  // all that is reached is farther
            beside = {reached.tl(), cv::Size()};
        squares.push_back(beside);
        for (int shift = 1; shift <= top; ++shift) {
            squares.push_back(grown(cells_of(squares.back(), 2), margin, margin));
            if (shift == smooth)
                squares.back() |= grown(cells_of(reached, 1 << smooth), 1, 1);
        }
    }

    // The reached pixels above, below, to the left and to the right of those beside the marker.
    std::array<cv::Rect, 4> farther() const {
        const cv::Point from = reached.tl(), to = reached.br(), a = beside.tl(), b = beside.br();
        return {cv::Rect(from, cv::Point(to.x, a.y)), cv::Rect(cv::Point(from.x, b.y), to),
                cv::Rect(cv::Point(from.x, a.y), cv::Point(a.x, b.y)),
                cv::Rect(cv::Point(b.x, a.y), cv::Point(to.x, b.y))};
    }
};

// Adds the smooth grid's sums, or writes them and the background, to a part of the region.
void add_smooth(const cv::Mat& sums, const cv::Rect& squares, int shift, const cv::Rect& part,
                const cv::Rect& region, std::optional<float> background, cv::Mat& pixels) {
    const bool past_caches = is_past_caches(pixels);
    const float base = background.value_or(0.0f);
    // The squares between whose middles the part's pixels lie.
    const cv::Rect between = grown(cells_of(part, 1 << shift), 1, 1);
    const int left = between.x - squares.x;
    tbb::parallel_for(tbb::blocked_range<int>(part.y, part.br().y, 16), [&](const auto& range) {
        std::vector<float> row(static_cast<std::size_t>(between.width));
        for (int y = range.begin(); y < range.end(); ++y) {
            // In half pixels, from the middle of the square with the index 0.
            const int place = 2 * y + 1 - (1 << shift), above = place >> (shift + 1);
            const auto way =
                static_cast<float>(place - above * (2 << shift)) / static_cast<float>(2 << shift);
            const float* from = sums.ptr<float>(above - squares.y) + left;
            const float* next = sums.ptr<float>(above + 1 - squares.y) + left;
            for (std::size_t x = 0; x < row.size(); ++x)
                row[x] = from[x] + way * (next[x] - from[x]) + base;
            float* to = pixels.ptr<float>(y - region.y) + (part.x - region.x);
            if (background)
                set_ramps(row.data() - between.x, shift, part.x, part.br().x, past_caches, to);
            else
                add_ramps(row.data() - between.x, shift, part.x, part.br().x, to);
        }
    });
}

// The rings of one camera's tail that a reach and a blur take: one for each of the shifts `first`
// to `top`; none if top < first.
struct Rings {
    const ImageFilter& filter;
    int first, top;

    Rings(const ImageFilter& image_filter, double reach_px, int finest)
        : filter(image_filter), first(finest), top(filter.first_ring() - 1) {
        while (filter.radius_held(top + 1) < reach_px && top < SquareCorners::max_shift)
            ++top;
        if (top >= filter.first_ring())
            top = std::max(top, first);
    }

    const FilterKernel& on(int shift) const {
        return filter.ring(std::max(shift, first), shift <= first);
    }

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

TailPyramid::TailPyramid(const ImageFilter& filter, const Projector& projector,
                         const cv::Rect& pixels)
    : filter_(filter), corners_(projector, pixels) {}

cv::Rect TailPyramid::sources(const TileSamples& samples, const MarkerView& marker,
                              const std::vector<Eigen::Vector2d>& outline,
                              const cv::Rect& limit) const {
    return source_pixels(samples, marker, corners_.projector().camera().intrinsics, outline, limit);
}

FarTail::FarTail(const ImageFilter& filter, const cv::Rect& pixels)
    : shift(smooth_shift(filter)),
      region(pixels),
      squares(grown(cells_of(pixels, 1 << shift), 1, 1)) {}

void FarTail::add(const cv::Mat& more, const cv::Rect& of_squares) {
    if (sums.empty())
        sums = cv::Mat::zeros(squares.size(), CV_32FC1);
    const cv::Rect both = squares & of_squares;
    sums(both - squares.tl()) += more(both - of_squares.tl());
}

void FarTail::add_to(cv::Mat& pixels) const {
    if (!sums.empty())
        add_smooth(sums, squares, shift, region, region, std::nullopt, pixels);
}

void TailPyramid::add(const TileSamples& samples, const MarkerView& marker, const cv::Rect& seen_at,
                      double reach_px, int finest, const cv::Rect& region,
                      std::optional<float> background, FarTail& far, cv::Mat& pixels,
                      const std::function<void(const cv::Rect&)>& done) const {
    constexpr int min_outside = 3;  // shift of the squares outside the samples
    constexpr double max_px = 1e5;
    const Rings rings(filter_, std::min(reach_px, max_px), finest);
    const int reach = static_cast<int>(std::ceil(std::min(reach_px, max_px)));
    TailSources sources(samples, marker, corners_, seen_at & grown(region, reach, reach));
    cv::Rect reached = grown(sources.pixels(), reach, reach) & region;
    if (sources.pixels().empty() || rings.top < rings.first)
        reached = {};
    if (background)
        set_outside(reached, region, *background, pixels);
    if (reached.empty())
        return for_each_band(region, done);
    const Targets targets(sources.pixels(), reached, smooth_shift(filter_),
                          std::max(rings.top, min_outside));
    sources.average(rings.sources(targets.squares), std::min(rings.first, min_outside - 1));
    cv::Mat coarser;
    // The sums of a band of a grid: those of the coarser grids, or the background, and its own.
    const auto add_band = [&](int shift, const cv::Rect& band, std::optional<float> base,
                              cv::Mat& sums) {
        const cv::Rect& target = targets.squares[static_cast<std::size_t>(shift)];
        if (shift < rings.top)
            add_refined(coarser, targets.squares[static_cast<std::size_t>(shift + 1)], target, band,
                        base, sums);
        else if (base)
            sums(band - target.tl()).setTo(*base);
        if (shift >= rings.first)
            add_filtered_band(sources.field(shift), rings.on(shift), target, band, sums);
    };
    for (int shift = rings.top; shift > 0; --shift) {
        const cv::Rect& target = targets.squares[static_cast<std::size_t>(shift)];
        cv::Mat sums(target.size(), CV_32FC1);
        for_each_band(target, [&](const cv::Rect& band) { add_band(shift, band, 0.0f, sums); });
        if (shift == targets.smooth && background) {
            for (const cv::Rect& part : targets.farther())
                add_smooth(sums, target, shift, part, region, background, pixels);
        } else if (shift == targets.smooth) {
            // Beside the marker finer grids take the place of what will come from there.
            far.add(sums, target);
            add_smooth(-sums, target, shift, targets.beside, region, std::nullopt, pixels);
        }
        coarser = sums;
    }
    cv::Mat beside = pixels(targets.beside - region.tl());
    for_each_band(region, [&](const cv::Rect& band) {
        if (const cv::Rect own = band & targets.beside; !own.empty())
            add_band(0, own, background, beside);
        done(band);
    });
}

}  // namespace etalon
