// How wrong a render can be for sampling the image at k x k places a pixel: the bounds from which k
// is chosen. 1-D and numeric: the pixel's weights on the samples of a straight edge along the pixel
// rows, against the exact response, for the worst place of the edge. An edge along the rows is the
// worst: across a slanted one the errors of a pixel's rows have different signs (measured: a third
// at 20 to 45 degrees; docs/rendering.md).
//
// A scene's error is this times the largest step between neighbouring cells; a second edge within
// the same pixel adds its own.
#pragma once

#include <map>
#include <mutex>
#include <utility>

#include "sim/sharpened_spread.h"

namespace etalon {

// Safe from every thread; remembers what it has computed (some ms each).
class SamplingBound {
public:
    // The spread smooths the errors; none: the pixel's box alone.
    explicit SamplingBound(const PointSpreadFunction* spread);

    // Of exact lens averages at points (method E), for an edge of contrast 1 under a blur of this
    // radius > 0 or a larger one; gray. Falls with the radius and, but for ripples, with k.
    double of_points(int k, double blur_radius_px) const;

    // Of exact areas over boxes (method C) of a sharp edge of contrast 1; gray.
    double of_boxes(int k) const;

    // Of exact averages over the sharpened spread's disk, for a sharp edge of contrast 1; gray.
    double of_disks(int k, const SharpenedSpread& sharpened) const;

    // Of box averages in place of the spread, for a sharp edge of contrast 1; gray.
    double of_no_spread() const { return of_no_spread_; }

    // The line spread's largest value, 1/px: the steepest slope of an edge before the pixel's box;
    // 0 without a spread.
    double line_spread_peak() const { return peak_; }

private:
    double at_blur(int k, double blur_radius_px, int index) const;
    // The spread seen along one axis: its energy in bins of 1/bins_per_px, symmetric about bin 0.
    std::vector<double> line_spread(int bins_per_px) const;

    const PointSpreadFunction* spread_;
    double peak_ = 0.0, of_no_spread_ = 0.0;
    mutable std::mutex mutex_;
    mutable std::map<std::pair<int, int>, double> of_points_;  // by k and bin of the radius
    mutable std::map<int, double> of_boxes_, of_disks_;
};

}  // namespace etalon
