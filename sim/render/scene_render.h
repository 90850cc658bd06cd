// Markers before an image: the closed-form methods know one radiance behind the markers; here they
// are put over a whole picture.
#pragma once

#include "core/image/image.h"
#include "sim/render/renderer.h"
#include "sim/sensor/sensor_model.h"

namespace etalon {

// M + (1 - C) B by pixel: M is the markers on black, C the same markers all white on black (their
// coverage), B the background as the camera sees it without markers, its own blur included. All are
// CV_32FC1 of one size. Exact where B is even across what a marker's edge is blurred over; there a
// real background would be cut by the edge first and blurred then.
// Throws NumericalError for different sizes or types, and for a background that is not finite.
Radiance placed_over(const Radiance& markers, const Radiance& coverage, const Radiance& background);

// The scene without its own background, and its markers as one white cell each.
Scene on_black(const Scene& scene);
Scene white_on_black(const Scene& scene);

// Two renders, each with its share of the tolerance, put together as above. `scene.background` is
// not used; the background must have the camera's size. The plan is that of M. Throws as render()
// and placed_over() do.
RenderedImage render_over(const Renderer& renderer, const Scene& scene, const Radiance& background,
                          const RenderOptions& options = {});

// The radiance before the sensor that gives these code values, relative response undone: what
// SensorModel::expose() turns into the same image again (to a code). A saturated code is full
// scale. Throws NumericalError unless the image has the sensor's size and bit depth.
Radiance background_from(const CodeImage& image, const SensorModel& sensor);

}  // namespace etalon
