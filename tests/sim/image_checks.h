// Images against the reference integrator, and against those of parts and of other threads.
#pragma once

#include <tbb/global_control.h>

#include "sim/render/reference_integrator.h"
#include "sim/render/renderer.h"
#include "tests/test.h"

namespace etalon::test {

// Within 0.1 gray and so many of the reference's own standard errors. Gives the reference.
inline std::vector<ReferencePixel> expect_reference(const cv::Mat& radiance,
                                                    const CameraModel& camera, const Scene& scene,
                                                    const std::vector<cv::Point>& pixels,
                                                    const ReferenceOptions& options,
                                                    double standard_errors = 4.0) {
    const auto reference = integrate_reference(camera, scene, pixels, options);
    for (std::size_t i = 0; i < pixels.size(); ++i)
        EXPECT_NEAR(radiance.at<float>(pixels[i]), reference[i].mean,
                    0.1 / 255.0 + standard_errors * reference[i].standard_error)
            << pixels[i];
    return reference;
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
