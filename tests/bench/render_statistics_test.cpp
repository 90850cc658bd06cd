// The renderer against the reference integrator, at reduced size. Full size: etalon bench.

#include <gtest/gtest.h>

#include "bench/render_comparison.h"

namespace etalon {
namespace {

// The differences are the render's error (asked: RMS <= 0.1 gray) plus the reference's independent
// noise of known standard errors s_i. Mean square of the noise: mean(s^2), with the variance
// (2 + 4/15) / n * mean(s^4): s^2 is itself estimated from 16 scrambles and varies by 2/15 of its
// square, twice. Five such standard deviations are allowed.
void expect_within_tolerance(const BenchmarkScene& scene, const std::string& name) {
    const RenderedImage image = Renderer(scene.camera).render(scene.scene);
    const RenderTruth truth =
        integrate_truth(scene.camera, scene.scene, 5, {.samples_per_scramble = 1024});
    const RenderComparison c = compare_with_truth(values_at(image.radiance, truth.pixels), truth);
    const double noise = c.reference_rms_gray * c.reference_rms_gray;
    const double spread = std::sqrt((2.0 + 4.0 / 15.0) / c.pixels * c.reference_fourth);
    EXPECT_LT(c.rms_gray * c.rms_gray, 0.1 * 0.1 + noise + 5.0 * spread)
        << name << ": " << image.plan.describe();
    // Student's t with 15 degrees of freedom exceeds 8 once in 10^6.
    EXPECT_LT(c.max_sigmas, 8.0) << name;
    EXPECT_LT(c.reference_rms_gray, 0.6) << name << ": the reference is too noisy to tell";
}

class RenderAccuracy : public testing::TestWithParam<std::string> {};

TEST_P(RenderAccuracy, IsATenthOfAGrayAgainstTheReference) {
    expect_within_tolerance(benchmark_scene(GetParam()), GetParam());
}

INSTANTIATE_TEST_SUITE_P(Scenes, RenderAccuracy,
                         testing::Values("webcam-500", "webcam-1000", "webcam-1500", "sharp-500",
                                         "sharp-1000", "sharp-1500", "focus-152", "canon-500",
                                         "canon-900"));

// Scenes that leave the common path, as changes of sharp-1000 or webcam-500.
BenchmarkScene odd_scene(const std::string& name) {
    BenchmarkScene scene = benchmark_scene(
        name == "gaussian" || name == "wide aperture" || name == "oblong pixels" ? "webcam-500"
                                                                                 : "sharp-1000");
    CameraModel& camera = scene.camera;
    if (name == "oblong pixels")
        camera.intrinsics.fy *= 1.7;
    if (name == "gaussian")
        camera.lens->psf = {PointSpread::Kind::gaussian, 0.8};
    if (name == "wide aperture")
        camera.lens->f_number = 0.95;
    if (name == "focus inside the marker")  // blur radii 0 to 0.9 px
        camera.lens->f_number = 0.06;
    if (name == "focus at infinity")
        camera.lens->focus_distance_mm = std::numeric_limits<double>::infinity();
    if (name == "gray background")
        scene.scene.background = 0.37;
    if (name == "small tag")
        scene.scene.markers[0].grid.cell_mm *= 0.15;
    if (name == "no lens")
        camera.lens.reset();
    if (name == "tilted sensor")
        camera.distortion.tau_x = 0.06, camera.distortion.tau_y = -0.04;
    if (name == "all coefficients") {
        camera.distortion = {-0.286, 0.057, 0.002, -0.003, 0.112, 0.01, 0.02,
                             -0.01,  0.004, 0.001, -0.003, 0.002, 0.0,  0.0};
    }
    return scene;
}

class OddScenes : public testing::TestWithParam<std::string> {};

TEST_P(OddScenes, AreATenthOfAGrayFromTheReference) {
    expect_within_tolerance(odd_scene(GetParam()), GetParam());
}

INSTANTIATE_TEST_SUITE_P(Scenes, OddScenes,
                         testing::Values("oblong pixels", "gaussian", "wide aperture",
                                         "focus inside the marker", "focus at infinity",
                                         "gray background", "small tag", "no lens", "tilted sensor",
                                         "all coefficients"));

}  // namespace
}  // namespace etalon
