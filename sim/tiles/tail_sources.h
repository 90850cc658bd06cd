// What the tail of the diffraction pattern is summed over: averages of one marker's image over the
// squares of ever coarser grids, from the pixels on. Inside the sampled tiles they come from the
// samples; outside, squares of 8 px and more are averaged over 4 x 4 lens averages (finer grids
// take the value of the 8-px square).
//
// A grid is named by the binary logarithm of its step in px, its "shift"; square (i, j) holds the
// pixels from 2^shift (i, j) on.
#pragma once

#include <array>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "calib/camera/projector.h"
#include "sim/scene/marker_view.h"
#include "sim/tiles/core_filter.h"
#include "sim/tiles/lens_average.h"
#include "sim/tiles/tile_samples.h"

namespace etalon {

// Undistorted points at the corners of squares, one per camera; those of the pixels that were named
// and a margin are computed on first use, 16 x 16 at once (0.5 us each), others each time. Safe
// from every thread.
class SquareCorners {
public:
    static constexpr int max_shift = 20;

    using Corners = std::array<Eigen::Vector2d, 4>;  // left to right, then down

    // The projector must outlive it.
    SquareCorners(const Projector& projector, const cv::Rect& pixels)
        : projector_(projector), pixels_(pixels) {}

    const Projector& projector() const { return projector_; }

    // Of a square; nothing where a corner has no ray.
    std::optional<Corners> of(int shift, int i, int j) const;

private:
    static constexpr int part_side = 16;
    struct Part {
        std::once_flag once;
        std::vector<Eigen::Vector2d> points;  // NaN: no ray
    };
    struct Table {
        std::once_flag once;
        cv::Rect parts;
        std::unique_ptr<Part[]> of_parts;
    };

    Eigen::Vector2d compute(int shift, const cv::Point& node) const;
    Eigen::Vector2d point_at(int shift, const cv::Point& node) const;
    const Table& table(int shift) const;

    const Projector& projector_;
    cv::Rect pixels_;
    mutable std::array<Table, max_shift + 1> tables_;
};

// The pixels outside of which the marker is not, as far as they are within `limit`: of the image
// and beyond. `outline`: marker_outline() with 31 points a side.
cv::Rect source_pixels(const TileSamples& samples, const MarkerView& marker,
                       const Intrinsics& intrinsics, const std::vector<Eigen::Vector2d>& outline,
                       const cv::Rect& limit);

class TailSources {
public:
    // `pixels`: those of source_pixels(), or the part of them that matters. All must outlive it.
    TailSources(const TileSamples& samples, const MarkerView& marker, const SquareCorners& corners,
                const cv::Rect& pixels);

    const cv::Rect& pixels() const { return pixels_; }

    // Averages what the sums need: on each grid from the shift `finest` on, 0 to 2, the squares of
    // needed[shift]; there must be some for the shifts 2 and 3 at least.
    void average(const std::vector<cv::Rect>& needed, int finest);

    // The averages on a grid, for add_filtered() with k = 1.
    SampleField field(int shift) const;

private:
    void take_tiles(const cv::Rect& needed_tiles);
    void average_pixels();
    void average_squares(const std::vector<cv::Rect>& needed);
    void fill_tiles_outside();
    float lens_mean(int shift, int i, int j, LensAverage& lens_average) const;

    const TileSamples& samples_;
    const MarkerView& marker_;
    const SquareCorners& corners_;
    cv::Rect pixels_;
    std::vector<TileMap> squares_;  // by shift, from 2 on
    // Of each refined tile: its quarters and samples, and 4 x 4 averages of its pixels.
    std::unique_ptr<const float*[]> values_, pixel_values_;
    std::vector<float> pixel_averages_;
};

}  // namespace etalon
