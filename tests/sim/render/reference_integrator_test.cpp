// A measured radial profile in place of diffraction and defocus.

#include "sim/render/reference_integrator.h"

#include "bench/benchmark_scenes.h"
#include "sim/psf/diffraction.h"
#include "sim/psf/point_spread_sampler.h"
#include "sim/scene/pose_sampling.h"
#include "tests/evidence/edge_spread.h"
#include "tests/sim/edge_scenes.h"

namespace etalon {
namespace {

TEST(SobolPoints, FillEveryElementaryIntervalOnceUnderAnyScramble) {
    // 64 points of a (0, 6, 1) sequence in each coordinate: one in every 64th.
    const SobolPoints points(64);
    for (std::uint32_t number : {0u, 5u}) {
        const auto scramble = make_scramble(11, 3, 4, number);
        for (std::size_t d = 0; d < SobolPoints::dimensions; ++d) {
            std::vector<int> hits(64, 0);
            for (int i = 0; i < 64; ++i)
                ++hits[static_cast<std::size_t>(64.0 * points.point(i, scramble)[d])];
            EXPECT_EQ(hits, std::vector<int>(64, 1)) << "dimension " << d;
        }
    }
}

TEST(SobolPoints, ScramblesAreIndependent) {
    // Means of a smooth function over 16 points: over 400 scrambles, neighbours are uncorrelated.
    // The correlation of independent pairs has the standard deviation 1/20; allowed: four of them.
    const SobolPoints points(16);
    std::vector<double> means;
    for (std::uint32_t number = 0; number < 400; ++number) {
        const auto scramble = make_scramble(2, 7, 5, number);
        double sum = 0.0;
        for (int i = 0; i < 16; ++i) {
            const auto p = points.point(i, scramble);
            sum += p[0] * p[3] + p[1] * p[4] * p[5] - 0.375;
        }
        means.push_back(sum);
    }
    double square = 0.0, product = 0.0, total = 0.0;
    for (std::size_t i = 0; i < means.size(); ++i) {
        total += means[i];
        square += means[i] * means[i];
        product += means[i] * means[(i + 1) % means.size()];
    }
    EXPECT_LT(std::abs(product / square), 0.2);
    EXPECT_LT(std::abs(total) / 20.0, 4.0 * std::sqrt(square / 400.0));
}

TEST(ReferenceIntegrator, GivesAPinholesPixelItsArea) {
    CameraModel camera = camera_with(20, 16, {400.0, 300.0, 9.0, 7.0}, {});
    // From pixel x = 9 + 400 * 0.2 / 200 = 9.4 on.
    const CellGrid grid{cv::Mat::zeros(1, 1, CV_32FC1), {0.2, -40.0}, {100.0, 100.0}};
    const Scene scene{{{grid, {Eigen::Quaterniond::Identity(), {0.0, 0.0, 200.0}}}}, 0.9};
    const auto pixels = integrate_reference(camera, scene, {{9, 7}, {8, 7}, {10, 7}});
    EXPECT_NEAR(pixels[0].mean, 0.9 * 0.9, 1e-3);
    EXPECT_LT(pixels[0].standard_error, 5e-4);
    EXPECT_EQ(pixels[1].mean, 0.9);
    EXPECT_NEAR(pixels[2].mean, 0.0, 1e-12);
}

TEST(ReferenceIntegrator, GivesTheSameBytesForAnyNumberOfThreads) {
    const auto scene = benchmark_scene("webcam-1000");
    const cv::Rect region(470, 105, 9, 7);
    const ReferenceOptions options{.scrambles = 4, .samples_per_scramble = 64, .seed = 3};
    ReferenceImage one, two;
    {
        const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, 1);
        one = integrate_reference(scene.camera, scene.scene, region, options);
    }
    two = integrate_reference(scene.camera, scene.scene, region, options);
    EXPECT_EQ(cv::norm(one.mean, two.mean, cv::NORM_INF), 0.0);
    const auto listed = integrate_reference(scene.camera, scene.scene, {{473, 108}}, options);
    EXPECT_EQ(static_cast<float>(listed[0].mean), one.mean.at<float>(3, 3));
}

TEST(ReferenceIntegrator, RefusesOptionsWithoutAnError) {
    const auto scene = benchmark_scene("webcam-500");
    EXPECT_THROW(integrate_reference(scene.camera, scene.scene, {{1, 1}}, {.scrambles = 1}),
                 NumericalError);
    EXPECT_THROW(
        integrate_reference(scene.camera, scene.scene, {{1, 1}}, {.samples_per_scramble = 100}),
        NumericalError);
}

using std::numbers::pi;

CameraModel camera_seeing(const PointSpread& spread) {
    return camera_with_lens(64, 48, {700.0, 500.0, 31.0, 23.0}, {}, 6.0,
                            {2.8, 300.0, 550.0, spread});
}

const std::vector<std::pair<double, double>> measured_profile{
    {0.0, 4.0}, {0.5, 3.0}, {1.25, 0.7}, {3.0, 0.2}};

CameraModel measured_camera() {
    return camera_seeing({PointSpread::Kind::measured, 0.0, measured_profile});
}

TEST(PointSpreadSampler, InvertsTheEncircledEnergy) {
    const CameraModel airy = benchmark_scene("canon-500").camera;
    for (const CameraModel& camera : {airy, measured_camera()}) {
        const auto psf = PointSpreadFunction::of(camera);
        const PointSpreadSampler sampler(camera);
        for (const double energy : {0.0, 1e-6, 0.001, 0.02, 0.3, 0.77, 0.838, 0.95, 0.99, 0.9987})
            EXPECT_NEAR(psf.energy_within(sampler.radius_of(energy)), energy, 1e-5);
    }
    const auto energy_at = [](const CameraModel& camera, double energy) {
        return PointSpreadFunction::of(camera).energy_within(
            PointSpreadSampler(camera).radius_of(energy));
    };
    EXPECT_NEAR(energy_at(airy, 0.9999), 0.9999, 1e-6);  // past the table
    EXPECT_NEAR(energy_at(measured_camera(), 0.9999999), 0.9999999, 1e-5);
}

TEST(Measured, HoldsTheEnergyOfItsProfile) {
    const auto psf = PointSpreadFunction::measured(measured_profile);
    EXPECT_NEAR(psf.energy_within(3.0), 1.0, 1e-15);
    EXPECT_NEAR(psf.energy_within(7.0), 1.0, 1e-15);
    EXPECT_EQ(psf.density(3.1), 0.0);
    EXPECT_FALSE(psf.is_airy());
    EXPECT_NEAR(psf.density(0.25) / psf.density(0.0), 3.5 / 4.0, 1e-14);
    // Energy against the density by the midpoint rule.
    double sum = 0.0;
    constexpr int steps = 300000;
    for (int i = 0; i < steps; ++i) {
        const double r = 3.0 * (i + 0.5) / steps;
        sum += psf.density(r) * 2.0 * pi * r * 3.0 / steps;
        if (i % 30000 == 29999) {
            EXPECT_NEAR(psf.energy_within(3.0 * (i + 1) / steps), sum, 1e-9);
        }
    }
    EXPECT_NEAR(psf.energy_within(psf.radius_of_tail(0.1)), 0.9, 1e-12);
}

TEST(Measured, RefusesWhatIsNoProfile) {
    for (const auto& [row, value] :
         std::vector<std::pair<std::size_t, std::pair<double, double>>>{{0, {0.1, 4.0}},
                                                                        {2, {0.5, 0.7}},
                                                                        {3, {std::nan(""), 0.2}},
                                                                        {3, {3.0, -0.1}},
                                                                        {3, {3.0, std::nan("")}}}) {
        auto profile = measured_profile;
        profile[row] = value;
        EXPECT_THROW(PointSpreadFunction::measured(profile), NumericalError);
    }
    EXPECT_THROW(PointSpreadFunction::measured({{0, 1}, {1, 1}, {2, 0}}), NumericalError);
    EXPECT_THROW(PointSpreadFunction::measured({{0, 0}, {1, 0}, {2, 0}, {3, 0}}), NumericalError);
}

TEST(Measured, TakesThePlaceOfDefocus) {
    const CameraModel camera = camera_seeing({});
    EXPECT_GT(aperture_of(camera).radius_mm, 0.0);
    EXPECT_GT(blur_radius_px(camera, 200.0), 0.0);
    EXPECT_EQ(aperture_of(measured_camera()).radius_mm, 0.0);
    EXPECT_EQ(blur_radius_px(measured_camera(), 200.0), 0.0);
}

TEST(Measured, GivesAnEdgeTheProfileOfItsEnergyAtAnyDepth) {
    const CameraModel camera = measured_camera();
    const auto psf = PointSpreadFunction::measured(measured_profile);
    const auto profile = pixel_profile([&](double r) { return psf.energy_within(r); }, 6.0, 10);
    // The edge at pixel 31.4: 0.4 px are 0.4 * 200 / 700 mm.
    const Scene scene = half_plane(0.4 * 200.0 / 700.0, 200.0);
    const auto image = Renderer(camera).render(scene).radiance;
    for (int x = 26; x < 37; ++x) {
        const auto i = static_cast<std::size_t>(std::lround((31.4 - x + 6.0) * 10.0));
        EXPECT_NEAR(image.at<float>(20, x), profile[i], 0.1 / 255.0) << x;
    }
}

}  // namespace
}  // namespace etalon
