// What a render leaves out: turning an omission off changes no pixel by more than the tolerance.
#include "sim/tiles/render_plan.h"

#include "bench/benchmark_scenes.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

bool leaves_out(const RenderPlan& plan, NeglectedEffect what) {
    return std::any_of(plan.left_out.begin(), plan.left_out.end(),
                       [&](const NeglectedBound& left) { return left.what == what; });
}

double bound_of(const RenderPlan& plan, NeglectedEffect what) {
    double sum = 0.0;
    for (const NeglectedBound& left : plan.left_out)
        sum += left.what == what ? left.gray : 0.0;
    return sum;
}

// Renders with and without the omission; the change in gray.
double change_without(const CameraModel& camera, const Scene& scene, NeglectedEffect what) {
    const Renderer renderer(camera);
    const RenderedImage lean = renderer.render(scene);
    EXPECT_TRUE(leaves_out(lean.plan, what)) << name_of(what);
    const RenderedImage full = renderer.render(scene, {.keep = {what}});
    EXPECT_FALSE(leaves_out(full.plan, what)) << name_of(what);
    return test::largest_difference(lean.radiance, full.radiance) / gray;
}

TEST(Omissions, LensThatHardlyBlurs) {
    const CameraModel camera = small_camera({PointSpread::Kind::ideal, 0.0});
    const Scene scene = test::half_plane(0.13, 150.0 + 0.4);  // blur radius 0.0061 px
    const double change = change_without(camera, scene, NeglectedEffect::lens);
    // With the lens another method samples it, with an error of its own.
    const Renderer renderer(camera);
    const RenderPlan lean = renderer.render(scene).plan;
    const RenderPlan full = renderer.render(scene, {.keep = {NeglectedEffect::lens}}).plan;
    EXPECT_GT(change, 0.0);
    EXPECT_LT(change,
              bound_of(lean, NeglectedEffect::lens) + lean.sampling_gray + full.sampling_gray);
    EXPECT_LT(change, 0.1);
}

TEST(Omissions, DiffractionOfAVeryShortWavelength) {
    CameraModel camera = small_camera({PointSpread::Kind::ideal, 0.0});
    camera.lens->wavelength_nm = 0.05;
    const double change =
        change_without(camera, test::half_plane(0.13, 190.0), NeglectedEffect::diffraction);
    EXPECT_LT(change, 0.1);
}

TEST(Omissions, TailBeyondItsReach) {
    const BenchmarkScene webcam = benchmark_scene("webcam-1000");
    const double change = change_without(webcam.camera, webcam.scene, NeglectedEffect::tail);
    EXPECT_GT(change, 0.0);
    EXPECT_LT(change,
              bound_of(Renderer(webcam.camera).render(webcam.scene).plan, NeglectedEffect::tail));
}

TEST(Omissions, UniformTilesAreWhatTheirSamplesWouldBe) {
    for (const char* name : {"webcam-500", "sharp-1000"}) {
        const BenchmarkScene scene = benchmark_scene(name);
        // But for single precision's rounding.
        EXPECT_LT(change_without(scene.camera, scene.scene, NeglectedEffect::uniform_tiles), 4e-3);
    }
}

TEST(Omissions, DistortionThatIsNotThere) {
    BenchmarkScene scene = benchmark_scene("webcam-500");
    scene.camera.distortion = {};
    const RenderedImage without = Renderer(scene.camera).render(scene.scene);
    EXPECT_TRUE(leaves_out(without.plan, NeglectedEffect::distortion));
    scene.camera.distortion.k1 = 1e-13;  // too small to see, but all of the machinery runs
    const RenderedImage with = Renderer(scene.camera).render(scene.scene);
    EXPECT_FALSE(leaves_out(with.plan, NeglectedEffect::distortion));
    EXPECT_LT(test::largest_difference(without.radiance, with.radiance), 0.01 * gray);
}

TEST(RenderPlan, CountsEveryTileAndNamesItsBounds) {
    const BenchmarkScene webcam = benchmark_scene("webcam-500");
    const RenderPlan plan = Renderer(webcam.camera).render(webcam.scene).plan;
    EXPECT_EQ(plan.method, RenderMethod::exact_lens);
    EXPECT_EQ(plan.tolerance_gray, 0.1);
    EXPECT_NEAR(plan.max_blur_radius_px, 2.03, 0.01);
    EXPECT_GT(plan.tail_reach_px, 80.0);
    EXPECT_LT(plan.sampling_gray, 0.1);
    ASSERT_EQ(plan.used.size(), 1u);
    EXPECT_EQ(plan.used[0].points_per_pixel_side, plan.points_per_pixel_side);
    // The tag's image is some 75 x 75 px with its turn, blur and the filter's reach: 400 tiles.
    EXPECT_GT(plan.used[0].tiles, 150);
    EXPECT_LT(plan.used[0].tiles, 500);
    EXPECT_GT(plan.uniform_tiles, 640 * 480 / 16 - 500);
    EXPECT_THAT(plan.describe(), HasSubstr("exact lens averages, "));
}

TEST(RenderPlan, TakesMoreSamplesForATighterToleranceAndRefusesTheImpossible) {
    const BenchmarkScene webcam = benchmark_scene("webcam-500");
    const Renderer renderer(webcam.camera);
    const auto k = [&](double tolerance) {
        return renderer.render(webcam.scene, {.tolerance_gray = tolerance})
            .plan.points_per_pixel_side;
    };
    EXPECT_LT(k(1.0), k(0.1));
    EXPECT_LT(k(0.1), k(0.01));
    EXPECT_THROW(k(1e-6), NumericalError);
    // Lens averages at points cannot resolve an edge that is not blurred at all.
    const BenchmarkScene sharp = benchmark_scene("sharp-1000");
    EXPECT_THROW(Renderer(sharp.camera).render(sharp.scene, {.method = RenderMethod::exact_lens}),
                 NumericalError);
}

}  // namespace
}  // namespace etalon
