// The choice of method and sampling for an image, from bounds on its blur and on its diffraction
// tail.
#pragma once

#include "sim/image_filter.h"
#include "sim/marker_view.h"
#include "sim/renderer.h"
#include "sim/tile_samples.h"

namespace etalon {

struct RenderSampling {
    RenderPlan plan;
    Sampling sampling;
};

// `contrast` is the largest difference of a cell from the background.
// For the method `reference`, which samples by itself, the plan only records the scene's blur.
RenderSampling choose_sampling(const BlurRange& blur, double contrast, const ImageFilter& filter,
                               const RenderOptions& options);

}  // namespace etalon
