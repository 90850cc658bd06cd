// What is measured along edges, on photographs by the reference integrator with shot, read and
// quantisation noise: each result against its stated uncertainty over many draws of the noise.
//
// The integrator's own error is the same in all draws of a scene: it is kept to a tenth of the
// noise's variance, so that the mean pull of n draws has a standard deviation of up to
// sqrt(1/n + 0.1), here below 0.4. Limits: means within 3.5 of those; chi-square of the pulls below
// its 99.9 % quantile, 1 + 3.1 sqrt(2/n) + 2/n or so, plus the square of what the mean may be.

#include <cstdio>

#include "compare/characterise/blur_estimate.h"
#include "compare/characterise/slanted_edge.h"
#include "sim/psf/diffraction.h"
#include "tests/compare/edges/edge_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int draws = 24;
constexpr double max_mean = 1.2;     // 3.5 sqrt(1/24 + 0.1) is 1.3
constexpr double max_square = 2.6;   // 1 + 3.1 sqrt(2/24) + 2/24 = 2.0, and 0.6 for the mean
constexpr double min_square = 0.15;  // an uncertainty must not be a multiple of the scatter

void expect_fair(const char* what, const Pulls& pulls) {
    std::printf("%-34s pulls: mean %6.2f, mean square %5.2f, n %d\n", what, pulls.mean(),
                pulls.square(), pulls.count);
    EXPECT_LT(std::abs(pulls.mean()), max_mean) << what;
    EXPECT_LT(pulls.square(), max_square) << what;
    EXPECT_GT(pulls.square(), min_square) << what;
}

CodeImage draw(const EdgeScene& scene, const Radiance& radiance, int seed) {
    return SensorModel(scene.camera)
        .expose(radiance, NoiseKey{17, static_cast<std::uint32_t>(seed)});
}

TEST(EdgeStatistics, WidthAndMeasuredPatternAreWithinTheirUncertainty) {
    for (const double sigma : {0.3, 0.7}) {
        const EdgeScene scene = small_board(sigma);
        const Radiance radiance = scene.reference(128);
        Pulls width, modulation;
        int sharpened = 0;
        for (int seed = 0; seed < draws; ++seed) {
            const auto estimate =
                estimate_point_spread(scene.edges(draw(scene, radiance, seed)), scene.camera);
            width.add(estimate.gaussian.sigma_px - sigma,
                      estimate.gaussian.standard_uncertainty_px);
            const auto [value, u] = estimate.measured->modulation(0.3);
            modulation.add(value - gaussian_transfer(sigma, 0.3), u);
            sharpened += estimate.sharpening.is_detected ? 1 : 0;
        }
        std::printf("sigma %.1f px\n", sigma);
        expect_fair("Gaussian's width", width);
        expect_fair("measured pattern's MTF at 0.3/px", modulation);
        EXPECT_EQ(sharpened, 0);
    }
}

TEST(EdgeStatistics, FocusAndFNumberAreWithinTheirUncertainty) {
    const EdgeScene scene = defocused_board();
    const Radiance radiance = scene.reference(128);
    Pulls focus, number, width;
    for (int seed = 0; seed < draws; ++seed) {
        const auto estimate =
            estimate_defocus(scene.edges(draw(scene, radiance, seed)), scene.camera);
        ASSERT_TRUE(estimate.is_determined) << estimate.undetermined;
        focus.add(estimate.focus_distance_mm - scene.camera.lens->focus_distance_mm,
                  estimate.focus_distance_standard_uncertainty_mm);
        number.add(estimate.f_number - scene.camera.lens->f_number,
                   estimate.f_number_standard_uncertainty);
        width.add(estimate.sigma_px * estimate.sigma_px - 0.25,
                  std::sqrt(estimate.covariance(2, 2)));
    }
    expect_fair("focus distance", focus);
    expect_fair("f-number", number);
    expect_fair("width at focus", width);
}

struct EdgeInView {
    CameraModel camera;
    Radiance radiance;
};

// One straight edge at this angle down 320 rows, `room_px` or more from both sides.
EdgeInView edge_in_view(double degrees, double room_px, bool is_diffraction) {
    const double moves = 320.0 * std::tan(degrees * std::numbers::pi / 180.0);
    EdgeInView view{edge_camera(static_cast<int>(moves + 2.0 * room_px), 320), {}};
    view.camera.distortion = {};
    view.camera.intrinsics.fy = view.camera.intrinsics.fx;
    view.camera.sensor->gain_e_per_dn = 10.0;  // 40 000 electrons: a signal to noise of 200
    view.camera.sensor->read_noise_e = 20.0;
    if (is_diffraction) {
        view.camera.lens->f_number = 2.8;
        view.camera.sensor->gain_e_per_dn *= 4.0;
        view.camera.sensor->read_noise_e *= 2.0;
    } else
        set_gaussian(view.camera, 0.5);
    CellGrid grid;
    grid.cells = (cv::Mat_<float>(1, 2) << 0.08f, 0.85f);
    grid.corner_mm = {-400.0, -300.0};
    grid.cell_mm = {400.0, 600.0};
    const Rigid pose = pose_of(0.0, 0.0, degrees * std::numbers::pi / 180.0, 0.0, 0.0, 500.0);
    view.radiance =
        integrate_reference(
            view.camera, {{{grid, pose}}, 0.3}, {0, 0, view.camera.width, view.camera.height},
            {.samples_per_scramble = is_diffraction ? 32 : 64, .stop_at_gray = 0.01})
            .mean;
    return view;
}

double analytic(const CameraModel& camera, double degrees, double f) {
    const double pixel = pixel_transfer_across(degrees, f);
    if (camera.lens->psf.kind == PointSpread::Kind::gaussian)
        return pixel * gaussian_transfer(camera.lens->psf.sigma_px, f);
    const double x = std::min(1.0, f * lambda_n_px(camera));
    return pixel * 2.0 / std::numbers::pi *  // Born and Wolf, 9.5.2: a circular aperture
           (std::acos(x) - x * std::sqrt(1.0 - x * x));
}

SlantedEdge measure(const EdgeInView& view, int seed) {
    const NoiseKey key{5, static_cast<std::uint32_t>(seed)};
    const CodeImage photo = SensorModel(view.camera).expose(view.radiance, key);
    return slanted_edge(linear_photo(photo, view.camera),
                        {0, 0, view.camera.width, view.camera.height});
}

// Up to half a cycle per pixel, over three draws.
void expect_within_a_hundredth(const EdgeInView& view, double degrees, Pulls& pulls) {
    double worst = 0.0;
    SlantedEdge edge;
    for (int seed = 0; seed < 3; ++seed) {
        edge = measure(view, seed);
        for (const ModulationRow& row : edge.modulation) {
            if (row.cycles_per_px > 0.5 || row.cycles_per_px == 0.0)
                continue;
            const double error = row.modulation - analytic(view.camera, degrees, row.cycles_per_px);
            pulls.add(error, row.standard_uncertainty);
            worst = std::max(worst, std::abs(error));
        }
    }
    std::printf("%5.0f  %6.3f  %.4f  %.4f +- %.4f (%.4f)  %.4f +- %.4f (%.3f)\n", degrees,
                edge.angle_deg, worst, edge.at_nyquist, edge.at_nyquist_standard_uncertainty,
                analytic(view.camera, degrees, 0.5), edge.mtf50_cycles_per_px,
                edge.mtf50_standard_uncertainty,
                analytic(view.camera, degrees, edge.mtf50_cycles_per_px));
    EXPECT_LT(worst, 0.01) << degrees;
    EXPECT_NEAR(edge.angle_deg, degrees, 0.02);
}

void print_heading(const char* lens) {
    std::printf(
        "%s\nangle  found             worst   at 0.5 (analytic)          MTF50 (analytic "
        "at it)\n",
        lens);
}

TEST(EdgeStatistics, ModulationIsWithinAHundredthOfTheAnalyticCurve) {
    print_heading("Gaussian 0.5 px");
    Pulls pulls;
    for (int degrees = 2; degrees <= 10; ++degrees)
        expect_within_a_hundredth(edge_in_view(degrees, 12.0, false), degrees, pulls);
    // Neighbouring frequencies of one edge share their noise; 27 edges of several independent ones.
    EXPECT_LT(pulls.square(), 1.7);
    EXPECT_GT(pulls.square(), 0.4);
}

// Light far from an Airy pattern's core is lost beyond the window's flat part, here 16 px:
// 2 lambda N / (pi^2 16) = 0.004 of it, by which all other frequencies come out too large. The
// noise is that of a mean of four photographs.
TEST(EdgeStatistics, ModulationBehindAnAiryPatternIsWithinAHundredth) {
    print_heading("Airy, lambda N 0.31 px");
    Pulls pulls;
    for (const int degrees : {2, 5, 10})
        expect_within_a_hundredth(edge_in_view(degrees, 34.0, true), degrees, pulls);
}

}  // namespace
}  // namespace etalon
