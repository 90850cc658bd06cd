#include "sim/render/reference_integrator.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "bench/benchmark_scenes.h"
#include "core/program/errors.h"
#include "sim/psf/diffraction.h"
#include "sim/psf/point_spread_sampler.h"
#include "sim/scene/pose_sampling.h"

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

TEST(PointSpreadSampler, InvertsTheEncircledEnergy) {
    const CameraModel camera = benchmark_scene("canon-500").camera;
    const PointSpreadSampler sampler(camera);
    const auto psf = PointSpreadFunction::of(camera);
    for (const double energy : {0.001, 0.3, 0.838, 0.95, 0.99, 0.9987})
        EXPECT_NEAR(psf.energy_within(sampler.radius_of(energy)), energy, 1e-5);
    EXPECT_NEAR(psf.energy_within(sampler.radius_of(0.9999)), 0.9999, 1e-6);  // past the table
}

TEST(ReferenceIntegrator, GivesAPinholesPixelItsArea) {
    CameraModel camera;
    camera.width = 20;
    camera.height = 16;
    camera.intrinsics = {400.0, 300.0, 9.0, 7.0};
    Scene scene{{PlacedMarker{}}};
    scene.markers[0].grid.cells = cv::Mat::zeros(1, 1, CV_32FC1);
    scene.markers[0].grid.cell_mm = {100.0, 100.0};
    scene.markers[0].grid.corner_mm = {0.2, -40.0};  // from pixel x = 9 + 400 * 0.2 / 200 = 9.4 on
    scene.markers[0].camera_from_marker.translation = {0.0, 0.0, 200.0};
    scene.background = 0.9;
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

}  // namespace
}  // namespace etalon
