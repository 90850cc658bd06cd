// The renderer against the reference integrator, at reduced size. Full size: etalon bench.

#include "bench/render_comparison.h"
#include "tests/test.h"

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

// Scenes that leave the common path.
struct OddScene {
    const char* name;
    const char* changed;  // the scene that it is but for `change`
    void (*change)(BenchmarkScene&);
};

void PrintTo(const OddScene& scene, std::ostream* out) {
    *out << scene.name;
}

const OddScene odd_scenes[] = {
    {"oblong pixels", "webcam-500", [](BenchmarkScene& odd) { odd.camera.intrinsics.fy *= 1.7; }},
    {"gaussian", "webcam-500",
     [](BenchmarkScene& odd) {
         odd.camera.lens->psf = {PointSpread::Kind::gaussian, 0.8};
     }},
    {"wide aperture", "webcam-500", [](BenchmarkScene& odd) { odd.camera.lens->f_number = 0.95; }},
    {"focus inside the marker, blur radii 0 to 0.9 px", "sharp-1000",
     [](BenchmarkScene& odd) { odd.camera.lens->f_number = 0.06; }},
    {"focus at infinity", "sharp-1000",
     [](BenchmarkScene& odd) {
         odd.camera.lens->focus_distance_mm = std::numeric_limits<double>::infinity();
     }},
    {"gray background", "sharp-1000", [](BenchmarkScene& odd) { odd.scene.background = 0.37; }},
    {"small tag", "sharp-1000",
     [](BenchmarkScene& odd) { odd.scene.markers[0].grid.cell_mm *= 0.15; }},
    {"no lens", "sharp-1000", [](BenchmarkScene& odd) { odd.camera.lens.reset(); }},
    {"tilted sensor", "sharp-1000",
     [](BenchmarkScene& odd) {
         odd.camera.distortion.tau_x = 0.06;
         odd.camera.distortion.tau_y = -0.04;
     }},
    {"all coefficients", "sharp-1000", [](BenchmarkScene& odd) {
         odd.camera.distortion = {-0.286, 0.057, 0.002, -0.003, 0.112, 0.01, 0.02,
                                  -0.01,  0.004, 0.001, -0.003, 0.002, 0.0,  0.0};
     }}};

class OddScenes : public testing::TestWithParam<OddScene> {};

TEST_P(OddScenes, AreATenthOfAGrayFromTheReference) {
    BenchmarkScene scene = benchmark_scene(GetParam().changed);
    GetParam().change(scene);
    expect_within_tolerance(scene, GetParam().name);
}

INSTANTIATE_TEST_SUITE_P(Scenes, OddScenes, testing::ValuesIn(odd_scenes));

}  // namespace
}  // namespace etalon
