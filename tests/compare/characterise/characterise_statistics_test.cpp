// Whether what characterises a sensor keeps its promise: over many seeds the pulls, (value - truth)
// / u, are those of a normal deviate or smaller. For each quantity the sum of n squared pulls is
// below the chi-square quantile, and not below what a U twice too large would give; the levels are
// family-wise: 0.01 over all of the file's quantities (16).
#include <cstdio>

#include "compare/characterise/blur_estimate.h"
#include "compare/characterise/illumination_estimate.h"
#include "compare/characterise/photon_transfer.h"
#include "compare/characterise/slanted_edge.h"
#include "sim/psf/diffraction.h"
#include "tests/compare/characterise/level_scenes.h"
#include "tests/compare/edges/edge_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int repetitions = 16;

// Wilson and Hilferty (1931) at 3.42 standard deviations, 0.01/16/2: for 16 degrees of freedom they
// are good to a percent.
double chi_square_limit(int degrees_of_freedom) {
    const double width = 2.0 / (9.0 * degrees_of_freedom);
    return degrees_of_freedom * std::pow(1.0 - width + 3.42 * std::sqrt(width), 3);
}

struct LevelPulls {
    double sum_of_squares = 0.0;
    int count = 0;

    void add(double value, double truth, double standard_uncertainty) {
        ASSERT_GT(standard_uncertainty, 0.0);
        sum_of_squares += std::pow((value - truth) / standard_uncertainty, 2);
        ++count;
    }
    void expect_covered(const char* quantity) const {
        EXPECT_LT(sum_of_squares, chi_square_limit(count)) << quantity;
    }
    // A U that is twice too large has a quarter of the sum; below that it says nothing.
    void expect_not_overstated(const char* quantity) const {
        EXPECT_GT(sum_of_squares, count / 4.0) << quantity;
    }
};

struct NoisePulls {
    LevelPulls black, gain, read_noise;
};

// Gain and read noise are covered.
NoisePulls noise_pulls(const char* of, const CameraModel& camera, double top) {
    SCOPED_TRACE(of);
    NoisePulls pulls;
    for (std::uint64_t seed = 1; seed <= repetitions; ++seed) {
        const BlackLevel black =
            measure_black_level(exposed(camera, even(camera, 0.0), 4, seed, 100));
        CameraModel measured = camera;
        measured.sensor->black_dn = black.dn;
        const std::vector<RepeatedView> views{exposed(camera, squares(camera, top), 4, seed)};
        const PhotonTransfer photon = measure_photon_transfer(views, measured, black);
        pulls.black.add(black.dn, camera.sensor->black_dn, black.standard_uncertainty_dn);
        pulls.gain.add(photon.gain_e_per_dn, camera.sensor->gain_e_per_dn,
                       photon.gain_standard_uncertainty);
        EXPECT_TRUE(photon.read_noise_e);
        pulls.read_noise.add(photon.read_noise_e.value_or(0.0), camera.sensor->read_noise_e,
                             photon.read_noise_standard_uncertainty_e);
    }
    pulls.gain.expect_covered("gain");
    pulls.read_noise.expect_covered("read noise");
    return pulls;
}

TEST(LevelsStatistics, BlackLevelGainAndReadNoiseAreCovered) {
    const NoisePulls pulls = noise_pulls("8 bits", noisy_camera(), 0.85);
    pulls.black.expect_covered("black");
    pulls.gain.expect_not_overstated("gain");
    pulls.read_noise.expect_not_overstated("read noise");
}

TEST(LevelsStatistics, GainAndReadNoiseAreCoveredBehindRec709AndWithTwelveBits) {
    CameraModel camera = with_tone_curve(noisy_camera());
    camera.sensor->read_noise_e = 5.0;
    noise_pulls("Rec. 709", camera, 0.85);
    camera = noisy_camera();
    camera.sensor->bits = 12;
    camera.sensor->black_dn = 160.3;
    camera.sensor->gain_e_per_dn = 2.5;
    noise_pulls("12 bits", camera, 0.9);
}

// Noise below half a code, where rounding rules: black levels at all fractions of a code.
TEST(LevelsStatistics, ABlackLevelBetweenTwoCodesIsCoveredWithLittleNoise) {
    LevelPulls pulls;
    for (int i = 0; i < repetitions; ++i) {
        CameraModel camera = noisy_camera();
        camera.sensor->read_noise_e = 12.0 * 0.3;
        camera.sensor->black_dn = 9.0 + (i + 0.5) / repetitions;
        const BlackLevel black = measure_black_level(
            exposed(camera, even(camera, 0.0), 4, 1 + static_cast<std::uint64_t>(i)));
        pulls.add(black.dn, camera.sensor->black_dn, black.standard_uncertainty_dn);
    }
    pulls.expect_covered("black between codes");
}

std::vector<ExposedPhoto> series(const CameraModel& camera, std::uint64_t seed) {
    return exposure_series(camera, squares(camera, 1.0),
                           {50, 100, 200, 350, 500, 700, 850, 1000, 1000, 1300, 2500}, seed);
}

// A soft shoulder, as a table: (r + 0.3 r (1 - r)).
CameraModel soft_camera() {
    CameraModel camera = noisy_camera();
    camera.sensor->transfer.kind = Transfer::Kind::table;
    for (int i = 0; i <= 64; ++i) {
        const double r = i / 64.0;
        camera.sensor->transfer.table.emplace_back(r, r + 0.3 * r * (1.0 - r));
    }
    return camera;
}

TEST(LevelsStatistics, AMeasuredTransferCurveIsCovered) {
    const CameraModel camera = soft_camera();
    std::array<LevelPulls, 3> pulls;
    constexpr std::array<std::size_t, 3> knots{20, 64, 108};  // of 129
    for (std::uint64_t seed = 1; seed <= repetitions; ++seed) {
        const TransferEstimate estimate =
            estimate_transfer(series(camera, seed), *camera.sensor, 0.003);
        ASSERT_EQ(estimate.transfer.kind, Transfer::Kind::table);
        for (std::size_t k = 0; k < knots.size(); ++k) {
            const auto [radiance, code] = estimate.transfer.table[knots[k]];
            pulls[k].add(code, encode(camera.sensor->transfer, radiance),
                         estimate.code_standard_uncertainty[knots[k]]);
        }
    }
    pulls[0].expect_covered("code in the shadows");
    pulls[1].expect_covered("code of the middle tones");
    pulls[2].expect_covered("code in the lights");
}

TEST(LevelsStatistics, TheTransferCurvesKindIsFound) {
    for (const Transfer::Kind kind : {Transfer::Kind::linear, Transfer::Kind::rec709})
        for (std::uint64_t seed = 1; seed <= 5; ++seed) {
            CameraModel camera = noisy_camera();
            camera.sensor->transfer.kind = kind;
            const TransferEstimate estimate =
                estimate_transfer(series(camera, seed), *camera.sensor, 0.003);
            EXPECT_EQ(estimate.transfer.kind, kind) << seed;
            if (kind == Transfer::Kind::linear) {
                // The largest of many departures that are each within their u: 4 of them are ample.
                EXPECT_LT(estimate.nonlinearity,
                          4.0 * estimate.nonlinearity_standard_uncertainty + 1e-4);
            }
        }
}

TEST(LevelsStatistics, RelativeIlluminationIsCovered) {
    CameraModel camera = noisy_camera();
    camera.sensor->illumination = {Illumination::Kind::polynomial, {-0.35, 0.1, -0.04}};
    std::array<LevelPulls, 4> pulls;
    for (std::uint64_t seed = 1; seed <= repetitions; ++seed) {
        std::vector<WhitePatch> patches;
        for (int k = 0; k < 3; ++k) {
            const Radiance field = image_of({320, 240}, [&](int x, int y) {
                return 0.75 * (1.0 + 0.05 * (x - 160) / 160.0 + 0.03 * k * (y - 120) / 120.0);
            });
            const CodeImage flat =
                exposed(camera, field, 1, seed, static_cast<std::uint32_t>(k)).front();
            const std::vector<WhitePatch> more = flat_patches(flat, camera, k, "flat");
            patches.insert(patches.end(), more.begin(), more.end());
        }
        const IlluminationEstimate estimate = estimate_illumination(patches, camera);
        EXPECT_EQ(estimate.illumination.kind, Illumination::Kind::polynomial);
        const auto& truth = camera.sensor->illumination.polynomial;
        for (std::size_t i = 0; i < 3; ++i)
            pulls[i].add(estimate.coefficients[i], truth[i], estimate.standard_uncertainty[i]);
        const double corner = illumination_radius_squared(camera, {-0.5, 239.5});
        pulls[3].add(estimate.at_corner, polynomial_illumination(truth, corner),
                     estimate.at_corner_standard_uncertainty);
    }
    pulls[0].expect_covered("c1");
    pulls[0].expect_not_overstated("c1");
    pulls[1].expect_covered("c2");
    pulls[2].expect_covered("c3");
    pulls[3].expect_covered("falloff at the corner");
}

// ---- edges

// What is measured along edges, on photographs by the reference integrator with shot, read and
// quantisation noise: each result against its stated uncertainty over many draws of the noise.
//
// The integrator's own error is the same in all draws of a scene: it is kept to a tenth of the
// noise's variance, so that the mean pull of n draws has a standard deviation of up to
// sqrt(1/n + 0.1), here below 0.4. Limits: means within 3.5 of those; chi-square of the pulls below
// its 99.9 % quantile, 1 + 3.1 sqrt(2/n) + 2/n or so, plus the square of what the mean may be.

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
