// How wrong a render with k x k samples a pixel can be beside a straight edge at its worst place:
// docs/rendering.md, "Plan". A scene's error is this times the largest step between neighbouring
// cells; a second edge within the pixel adds its own.
#pragma once

#include <bitset>

#include "sim/psf/deconvolved_psf.h"

namespace etalon {

// Directions of edges in the image: bit n stands for the tangent n / 64 of the angle to the nearest
// of the pixels' axes.
inline constexpr std::size_t tangent_steps = 64;
using EdgeTangents = std::bitset<tangent_steps + 1>;

// Blur radii, and up to which of them one disk stands for a sample's disk and the lens together;
// beyond, two or more.
struct DiskBlur {
    double smallest_px, largest_px, one_disk_up_to_px;
};

// Safe from every thread; remembers what it has computed (some ms each).
class SamplingBound {
public:
    // The spread smooths the errors; none: the pixel's box alone.
    explicit SamplingBound(const PointSpreadFunction* spread);

    // Of exact lens averages at points (method E), for an edge of contrast 1 under a blur of this
    // radius > 0 or a larger one; gray. Falls with the radius and, but for ripples, with k.
    double of_points(int k, double blur_radius_px, EdgeTangents tangents) const;

    // Of exact areas over boxes (method C) of a sharp edge of contrast 1; gray.
    double of_boxes(int k, EdgeTangents tangents) const;

    // Of exact averages over the sharpened spread's disk, for an edge of contrast 1 under any of
    // these blurs; gray. Thinned out: from 2 k places a side.
    double of_disks(int k, const DeconvolvedPsf& sharpened, const DiskBlur& blur,
                    EdgeTangents tangents, bool is_thinned = false) const;

    // Of box averages in place of the spread, for a sharp edge of contrast 1; gray.
    double of_no_spread() const { return of_no_spread_; }

    // The line spread's largest value, 1/px: the steepest slope of an edge before the pixel's box;
    // 0 without a spread.
    double line_spread_peak() const { return peak_; }

private:
    struct Known {
        std::mutex mutex;
        std::vector<float> errors;  // by the place of an edge along the pixels
        std::array<double, tangent_steps + 1> largest{};  // by tangent; 0: not computed
    };

    // The spread seen along one axis: its energy in bins of 1/bins_per_px, symmetric about bin 0.
    std::vector<double> line_spread(int bins_per_px) const;

    template <class Errors>
    double largest_of(int k, int index, EdgeTangents tangents, const Errors& errors) const;

    const PointSpreadFunction* spread_;
    double peak_ = 0.0, of_no_spread_ = 0.0;
    mutable std::mutex mutex_;
    mutable std::map<std::pair<int, int>, Known> known_;  // by k and bin of the radius
};

}  // namespace etalon
