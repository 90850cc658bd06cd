// What must hold of every image by a table of edges (and corners).
#pragma once

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "sim/render/renderer.h"

namespace etalon::test {

// The same bytes on any number of threads, and in a region by itself but for its tail.
inline void expect_the_same_everywhere(const CameraModel& camera, const Scene& scene,
                                       const cv::Rect& region) {
    const Renderer renderer(camera);
    const RenderedImage image = renderer.render(scene);
    const RenderedImage part = renderer.render(scene, {.region = region});
    EXPECT_LT(255.0 * cv::norm(image.radiance(region), part.radiance(region), cv::NORM_INF), 0.01);
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(cv::norm(image.radiance, renderer.render(scene).radiance, cv::NORM_INF), 0.0);
}

}  // namespace etalon::test
