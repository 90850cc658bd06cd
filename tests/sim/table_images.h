// What the images by tables of edges (and corners) are held against.
#pragma once

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>

#include "sim/render/reference_integrator.h"
#include "sim/render/renderer.h"

namespace etalon::test {

// In a region in which something is to be seen; within so many gray and the reference's own error.
inline void expect_as_the_reference(const CameraModel& camera, const Scene& scene,
                                    const cv::Rect& region, double gray) {
    const RenderedImage image = Renderer(camera).render(scene);
    const ReferenceImage reference =
        integrate_reference(camera, scene, region, {.scrambles = 16, .samples_per_scramble = 8192});
    const auto [least, most] =
        std::minmax_element(reference.mean.begin<float>(), reference.mean.end<float>());
    EXPECT_GT(*most - *least, 0.3f);
    for (int y = 0; y < region.height; ++y)
        for (int x = 0; x < region.width; ++x)
            EXPECT_NEAR(255.0 * image.radiance.at<float>(region.y + y, region.x + x),
                        255.0 * reference.mean.at<float>(y, x),
                        gray + 4.0 * 255.0 * reference.standard_error.at<float>(y, x));
}

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
