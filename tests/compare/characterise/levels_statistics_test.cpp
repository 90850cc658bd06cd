// Whether what characterises a sensor keeps its promise: over many seeds the pulls, (value - truth)
// / u, are those of a normal deviate or smaller. For each quantity the sum of n squared pulls is
// below the chi-square quantile, and not below what a U twice too large would give; the levels are
// family-wise: 0.01 over all of the file's quantities (16).

#include "compare/characterise/illumination_estimate.h"
#include "compare/characterise/photon_transfer.h"
#include "tests/compare/characterise/level_scenes.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int runs = 16;

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
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
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
    CameraModel camera = noisy_camera();
    camera.sensor->transfer.kind = Transfer::Kind::rec709;
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
    for (int i = 0; i < runs; ++i) {
        CameraModel camera = noisy_camera();
        camera.sensor->read_noise_e = 12.0 * 0.3;
        camera.sensor->black_dn = 9.0 + (i + 0.5) / runs;
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
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
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
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
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

}  // namespace
}  // namespace etalon
