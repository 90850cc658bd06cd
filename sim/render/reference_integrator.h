// The truth that other methods are measured against: brute-force sampling of the image model, with
// its standard error (docs/rendering.md, "Reference"). Slow; shares no integration code. Rays that
// miss the grid, or meet the plane behind the lens or from its back, and points without a ray are
// background; so is, without error, a pixel whose centre has no ray.
#pragma once

#include "sim/render/renderer.h"

namespace etalon {

struct ReferenceOptions {
    int scrambles = 16;               // at least 2
    int samples_per_scramble = 1024;  // a power of two
    std::uint64_t seed = 1;
    // For whole images: a pixel is finished early, with a quarter, a 16th ... of the samples, when
    // it and its neighbours have this standard error. 0: never, which alone is unbiased.
    double stop_at_gray = 0.0;
    std::stop_token stop = {};  // heeded from pixel to pixel; throws Interrupted
};

// One value per pixel, linear radiance. Parallel; the same bytes for any number of threads.
// About 0.1 us per sample. Throws NumericalError for numbers in camera, scene or options that are
// not finite or out of range.
struct ReferencePixel {
    double mean, standard_error;
};
std::vector<ReferencePixel> integrate_reference(const CameraModel& camera, const Scene& scene,
                                                const std::vector<cv::Point>& pixels,
                                                const ReferenceOptions& options = {});

// The same for a rectangle of the image; both CV_32FC1 of its size.
struct ReferenceImage {
    Radiance mean;
    cv::Mat standard_error;
};
ReferenceImage integrate_reference(const CameraModel& camera, const Scene& scene,
                                   const cv::Rect& region, const ReferenceOptions& options = {});

}  // namespace etalon
