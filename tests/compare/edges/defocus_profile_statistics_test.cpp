// A tilted board through focus, photographed by the reference integrator with noise, against
// renderings with the right lens, a wrong focus distance and a wrong f-number.

#include <cstdio>

#include "compare/edges/edge_summary.h"
#include "core/statistics/distributions.h"
#include "tests/compare/edges/edge_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr double true_focus_mm = 303.0;

// The photograph is always of test::defocused_board().
const Radiance& reference_radiance() {
    static const Radiance radiance = test::defocused_board().reference(64);
    return radiance;
}

struct Claim {
    const char* name;
    double focus_distance_mm, f_number;
};

struct Comparison {
    DefocusProfile profile;
    EdgeSummary summary;
    double median_chi_square;
};

Comparison compared(const Claim& claim, int seed) {
    test::EdgeScene scene = test::defocused_board();
    const CodeImage photo =
        SensorModel(scene.camera)
            .expose(reference_radiance(), NoiseKey{31, static_cast<std::uint32_t>(seed)});
    scene.camera.lens->focus_distance_mm = claim.focus_distance_mm;
    scene.camera.lens->f_number = claim.f_number;
    const PhotometricCamera camera(scene.camera);
    const ComparedArea area = compared_area(scene.board, {}, "test");
    PhotoState state{scene.pose, {}};
    state.photometry.black[0] = scene.camera.sensor->black_dn / 4095.0 * 255.0;
    state.photometry.white[0] = 255.0;
    const PhotoOfMarker with{gray_of(photo), scene.board.grid,
                             pixel_uses(camera.projector(), scene.pose, area), pixel_fitted, 0.3};
    const std::vector<EdgeShift> shifts = edge_shifts(with, camera, state);
    std::vector<double> chi_squares;
    for (const EdgeShift& edge : shifts)
        chi_squares.push_back(edge.reduced_chi_square);
    return {defocus_profile(photo, scene.rendered(), camera.projector(), scene.board.grid,
                            scene.pose, area, shifts),
            edge_summary(shifts), median(chi_squares)};
}

void print(const Claim& claim, const Comparison& found) {
    const DefocusProfile& profile = found.profile;
    std::printf("%s: focus by the photograph %.2f +- %.2f mm, by the rendering %.2f +- %.2f mm\n",
                claim.name, profile.photo.focus_distance_mm, profile.photo.standard_uncertainty_mm,
                profile.rendering.focus_distance_mm, profile.rendering.standard_uncertainty_mm);
    std::printf("  depth mm  edges  measured px^2     rendered  residual gray\n");
    for (const DepthBin& bin : profile.bins)
        std::printf("  %7.1f  %5d  %6.3f +- %.3f  %8.3f  %6.2f\n", bin.depth_mm, bin.edges,
                    bin.measured_px2, bin.measured_deviation_px2, bin.rendered_px2,
                    bin.residual_rms_gray);
}

// The photograph's noise is 3 gray on the edges, the integrator's own error 0.8 gray: chi-square
// 1.08. The integrator's error is common to all draws: a mean pull within 1.2 as in
// edges_statistics_test.cpp, where also the focus distance's 0.05 mm have room by which a parabola
// misses it.
TEST(DefocusProfile, OfTheRightLensIsTheRenderingsAndTheResidualIsNoise) {
    constexpr int draws = 8;
    test::Pulls focus, widths;
    for (int seed = 0; seed < draws; ++seed) {
        const Claim claim{"right lens", true_focus_mm, 1.4};
        const Comparison found = compared(claim, seed);
        if (seed == 0)
            print(claim, found);
        ASSERT_TRUE(found.profile.photo.is_determined) << found.profile.photo.undetermined;
        EXPECT_GT(found.profile.edges, 70);
        EXPECT_NEAR(found.median_chi_square, 1.08, 0.08);
        EXPECT_LT(found.summary.shift.rms_px, 0.005);
        focus.add(found.profile.photo.focus_distance_mm - true_focus_mm,
                  found.profile.photo.standard_uncertainty_mm);
        for (const DepthBin& bin : found.profile.bins)
            widths.add(bin.measured_px2 - bin.rendered_px2, bin.measured_deviation_px2);
    }
    std::printf("pulls: focus %.2f (mean square %.2f), widths %.2f (mean square %.2f)\n",
                focus.mean(), focus.square(), widths.mean(), widths.square());
    EXPECT_LT(std::abs(focus.mean()), 1.2);
    EXPECT_LT(focus.square(), 3.5);  // 99.9 % of chi-square with 8: 3.3
    EXPECT_LT(widths.square(), 1.9);
    EXPECT_GT(widths.square(), 0.4);
}

TEST(DefocusProfile, ShowsAWrongFocusDistanceAndWhereTheTrueOneIs) {
    const Claim claim{"focus 4 mm short", true_focus_mm - 4.0, 1.4};
    const Comparison found = compared(claim, 0);
    print(claim, found);
    const DefocusProfile& profile = found.profile;
    EXPECT_NEAR(profile.photo.focus_distance_mm, true_focus_mm,
                4.0 * profile.photo.standard_uncertainty_mm);
    EXPECT_LT(profile.photo.standard_uncertainty_mm, 0.3);
    EXPECT_NEAR(profile.rendering.focus_distance_mm, true_focus_mm - 4.0, 0.3);
    ASSERT_EQ(profile.bins.size(), 8u);
    const DepthBin &nearest = profile.bins.front(), &farthest = profile.bins.back();
    EXPECT_GT(nearest.measured_px2 - nearest.rendered_px2, 5.0 * nearest.measured_deviation_px2);
    EXPECT_LT(farthest.measured_px2 - farthest.rendered_px2,
              -5.0 * farthest.measured_deviation_px2);
    EXPECT_GT(nearest.residual_rms_gray, 1.1 * profile.bins[4].residual_rms_gray);
    EXPECT_GT(farthest.residual_rms_gray, 1.1 * profile.bins[4].residual_rms_gray);
}

// Thin lens: the disk's variance goes with 1 / N^2 (the focal length hardly changes): the widths
// beyond that in focus, where both have 0.25 px^2 and a rest, are about 2.04 times the rendering's.
TEST(DefocusProfile, ShowsAWrongFNumberOnBothSidesOfFocus) {
    const Claim claim{"f-number 2", true_focus_mm, 2.0};
    const Comparison found = compared(claim, 0);
    print(claim, found);
    const DefocusProfile& profile = found.profile;
    EXPECT_NEAR(profile.photo.focus_distance_mm, true_focus_mm,
                4.0 * profile.photo.standard_uncertainty_mm);
    ASSERT_EQ(profile.bins.size(), 8u);
    for (const DepthBin& bin : {profile.bins.front(), profile.bins.back()}) {
        EXPECT_NEAR((bin.measured_px2 - 0.25) / (bin.rendered_px2 - 0.25), 2.04, 0.15);
        EXPECT_GT(bin.residual_rms_gray, 1.3 * profile.bins[4].residual_rms_gray);
    }
    EXPECT_NEAR(profile.bins[4].measured_px2, profile.bins[4].rendered_px2, 0.015);
    EXPECT_GT(found.summary.mean_blur_px2, 5.0 * found.summary.mean_blur_deviation_px2);
}

TEST(DefocusProfile, SaysWhenAWidthHasNoLeastValue) {
    const test::EdgeScene scene = test::small_board(0.6);  // within 8 mm of depth, in focus
    const Radiance rendering = scene.rendered();
    const CodeImage photo = SensorModel(scene.camera).expose(rendering, NoiseKey{5, 1});
    const DefocusProfile profile =
        defocus_profile(photo, rendering, Projector(scene.camera), scene.board.grid, scene.pose,
                        compared_area(scene.board, {}, "test"), {});
    EXPECT_FALSE(profile.photo.is_determined);
    EXPECT_FALSE(profile.photo.undetermined.empty());
    EXPECT_EQ(profile.photo.focus_distance_mm, 0.0);
    EXPECT_GT(profile.edges, 40);
    CameraModel telecentric = scene.camera;
    telecentric.projection.kind = Projection::telecentric;
    EXPECT_THROW(defocus_profile(photo, rendering, Projector(telecentric), scene.board.grid,
                                 scene.pose, compared_area(scene.board, {}, "test"), {}),
                 NumericalError);
}

}  // namespace
}  // namespace etalon
