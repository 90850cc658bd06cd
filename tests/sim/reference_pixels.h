// Pixels of an image against the reference integrator.
#pragma once

#include <gtest/gtest.h>

#include "sim/render/reference_integrator.h"
#include "sim/render/renderer.h"

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

}  // namespace etalon::test
