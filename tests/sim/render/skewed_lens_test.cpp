// A lens before rows and columns that do not meet at right angles: its blur against the reference
// integrator, whose point spread leans in pixels as the columns do.
#include <gtest/gtest.h>

#include "core/program/errors.h"
#include "sim/render/reference_integrator.h"
#include "sim/render/renderer.h"
#include "tests/calib/cameras.h"
#include "tests/gray.h"

namespace etalon {
namespace {

// Disks of confusion of up to 2 px on both sides of the focus, the largest skew that a lens takes.
CameraModel skewed_camera(double f_number) {
    CameraModel camera = test::camera_with(120, 100, {905.0, 880.0, 57.0, 51.0}, {.k1 = -0.2});
    camera.intrinsics.skew = -max_skew_of_a_lens * camera.intrinsics.fx;
    camera.sensor.emplace();
    camera.sensor->pixel_pitch_um = 17.0;
    camera.lens.emplace();
    camera.lens->f_number = f_number;
    camera.lens->focus_distance_mm = 300.0;
    camera.lens->wavelength_nm = 550.0;
    return camera;
}

// Turned by 45 degrees, at which a pattern that leans shows most.
PlacedMarker tilted_marker() {
    PlacedMarker marker;
    marker.grid.cells = (cv::Mat_<float>(2, 3) << 0, 1, 0, 1, 0, 1);
    marker.grid.cell_mm = {7.0, 9.0};
    marker.grid.corner_mm = {-10.5, -9.0};
    marker.camera_from_marker = {rotation_from_vector({0.3, -0.7, 0.8}), {1.0, -0.5, 300.0}};
    return marker;
}

TEST(SkewedLens, IsBlurredAsItsRaysMeetTheMarker) {
    const Scene scene{{tilted_marker()}, 0.5};
    ReferenceOptions options;
    options.samples_per_scramble = 2048;
    std::vector<cv::Point> pixels;
    for (int y = 22; y < 80; y += 7)
        for (int x = 27; x < 90; x += 6)
            pixels.emplace_back(x, y);
    for (const double f_number : {1.4, 8.0}) {
        const CameraModel camera = skewed_camera(f_number);
        const RenderedImage image = Renderer(camera).render(scene);
        const auto truth = integrate_reference(camera, scene, pixels, options);
        for (std::size_t i = 0; i < pixels.size(); ++i)
            EXPECT_NEAR(image.radiance.at<float>(pixels[i]), truth[i].mean,
                        0.1 * gray + 4.0 * truth[i].standard_error)
                << "f/" << f_number << " " << pixels[i];
    }
}

TEST(SkewedLens, IsRefusedWhereItsPointSpreadWouldLean) {
    CameraModel camera = skewed_camera(1.4);
    camera.intrinsics.skew *= 1.01;
    EXPECT_THROW(Renderer{camera}, NumericalError);
}

}  // namespace
}  // namespace etalon
