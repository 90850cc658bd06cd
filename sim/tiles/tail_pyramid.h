// The tail of the diffraction pattern: what a marker adds to pixels from some to thousands of
// pixels away (docs/rendering.md, "Filter"). A grid is named by the binary logarithm of its step in
// px, its "shift"; square (i, j) holds the pixels from 2^shift (i, j) on.
#pragma once

#include "sim/tiles/image_filter.h"
#include "sim/tiles/tile_samples.h"

namespace etalon {

// Undistorted points at the corners of squares, one per camera. Those of the named pixels and a
// margin are kept, made 16 x 16 at once (0.5 us each). Safe from every thread.
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
    using Part = Lazy<std::vector<Eigen::Vector2d>>;  // NaN: no ray

    Eigen::Vector2d compute(int shift, const cv::Point& node) const;
    Eigen::Vector2d point_at(int shift, const cv::Point& node) const;

    const Projector& projector_;
    cv::Rect pixels_;
    std::array<Lazy<CellTable<Part>>, max_shift + 1> parts_;
};

// What several markers add to a region's pixels far from themselves: sums over the squares of a
// smooth grid, put into the pixels once for all markers.
struct FarTail {
    int shift;
    cv::Rect region, squares;
    cv::Mat sums;  // empty: nothing yet

    FarTail(const ImageFilter& filter, const cv::Rect& pixels);
    void add(const cv::Mat& more, const cv::Rect& of_squares);
    void add_to(cv::Mat& pixels) const;
};

// One per camera, or part of its image. Safe from every thread.
class TailPyramid {
public:
    // Filter and projector must outlive it. `pixels`: those that may see a marker.
    TailPyramid(const ImageFilter& filter, const Projector& projector, const cv::Rect& pixels);

    // The pixels within `limit` outside of which the marker is not: of the image and beyond.
    // `outline`: marker_outline() with 31 points a side.
    cv::Rect sources(const TileSamples& samples, const MarkerView& marker,
                     const std::vector<Eigen::Vector2d>& outline, const cv::Rect& limit) const;

    // Adds to the region's `pixels` (CV_32FC1, its size) the tail of everything within `reach_px`
    // (maybe infinite); `seen_at` is what sources() gave for the region with that room. With a
    // `background` writes both; without one leaves pixels far from the marker to `far`. The samples
    // must cover the region and ImageFilter::reach_px() around, best in multiples of 8 px.
    // `finest`: the first ring's shift. Calls `done` for each finished band (for_each_band()) from
    // its thread. Parallel, same bytes for any number.
    void add(const TileSamples& samples, const MarkerView& marker, const cv::Rect& seen_at,
             double reach_px, int finest, const cv::Rect& region, std::optional<float> background,
             FarTail& far, cv::Mat& pixels, const std::function<void(const cv::Rect&)>& done) const;

private:
    const ImageFilter& filter_;
    SquareCorners corners_;
};

}  // namespace etalon
