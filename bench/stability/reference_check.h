// A render against the reference integrator on a few pixels: quick enough to be done for every
// extreme case, and for every input of a fuzzer. Whole windows, percentiles and edge shifts are in
// bench/render_comparison.h.
#pragma once

#include <cstdint>
#include <vector>

#include "sim/render/reference_integrator.h"

namespace etalon {

// Pixels where something can be wrong, found from the geometry and not from a render: at the
// markers' corners, on their outlines and grid lines, and anywhere in the image. Distinct, inside
// the image, at most `count`.
std::vector<cv::Point> probe_pixels(const CameraModel& camera, const Scene& scene, int count,
                                    std::uint64_t seed);

struct ReferenceEffort {
    int samples_per_scramble = 2048;  // of 16; a power of two
    int rounds = 3;                   // pixels in doubt get 8 times as many in each further one
};

// The pixel whose difference is the largest part of its bound. Gray: 1/255 of full scale.
struct ReferenceCheck {
    cv::Point pixel{-1, -1};
    double difference_gray = 0.0;      // render minus reference
    double standard_error_gray = 0.0;  // of the reference
    double bound_gray = 0.0;           // tolerance + 4 standard errors
    int pixels = 0;

    bool within() const { return std::abs(difference_gray) <= bound_gray; }
};

// In doubt is a pixel beyond its bound, or in the first round one whose standard error is more than
// half the tolerance. Throws NumericalError as integrate_reference().
ReferenceCheck check_against_reference(const Radiance& radiance, const CameraModel& camera,
                                       const Scene& scene, const std::vector<cv::Point>& pixels,
                                       double tolerance_gray, const ReferenceEffort& effort = {});

}  // namespace etalon
