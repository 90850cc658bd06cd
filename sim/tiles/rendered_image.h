// What a renderer (sim/render/renderer.h) makes and a sensor (sim/sensor/sensor_model.h) sees.
#pragma once

#include "core/image/image.h"
#include "sim/tiles/render_plan.h"

namespace etalon {

struct RenderedImage {
    Radiance radiance;  // CV_32FC1, the camera's size
    // CV_8UC1: 255 where the pixel's ray exists, 0 outside the distortion model's valid region
    // (there the radiance is the background's). Shared by all images of a renderer: not to be
    // written to.
    cv::Mat valid;
    RenderPlan plan;
};

// A rendering without what sees nothing but the background: all that there is to a small marker in
// a large image.
struct RenderedPart {
    cv::Rect region;          // within the image; empty when all of it is background
    Radiance radiance;        // CV_32FC1, the region's size
    double background = 0.0;  // the radiance of all other pixels
    RenderPlan plan;

    // CV_32FC1 of the size of `other`, a rectangle of the image: part and background.
    Radiance within(const cv::Rect& other) const;
};

}  // namespace etalon
