// The choice of method and sampling for a marker's image: docs/rendering.md, "Plan".
#pragma once

#include "sim/render/renderer.h"
#include "sim/render/sampling_bound.h"
#include "sim/tiles/image_filter.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

struct RenderSampling {
    RenderPlan plan;
    Sampling sampling;
    bool with_spread = true;  // false: pixels are box averages
    int finest_ring = 0;      // of the tail: its grid's shift
};

// What of a marker's image the choice depends on.
struct ImageExtremes {
    BlurRange undistorted_blur;  // for the record
    BlurRange blur;              // as the sensor sees it
    double blur_slope;           // its change by px, about
    double blur_asymmetry;       // the part of that which a tilt of the marker does not explain
    double step;                 // largest difference of two neighbouring cells
    double contrast;             // largest difference of a cell from the background
    double area_px;              // of the marker's image, at least
    double cell_px;              // a cell's side where it is shortest, about
    EdgeTangents tangents;
    UndistortionMap::Bend bend;
    bool is_far_from_border;  // of the valid region: for a table of corners, which sees farther
    int markers = 1;          // in the scene: their omitted tails add up
};

// Throws NumericalError when the method that the options force cannot meet their tolerance.
// For the method `reference`, which samples by itself, the plan only records the scene's blur.
RenderSampling choose_sampling(const ImageExtremes& image, const ImageFilter& filter,
                               const SamplingBound& bound, const RenderOptions& options);

}  // namespace etalon
