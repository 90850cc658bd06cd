// A measured radial profile in place of diffraction and defocus.
#include <gtest/gtest.h>

#include <numbers>

#include "core/program/errors.h"
#include "sim/psf/diffraction.h"
#include "sim/psf/point_spread_sampler.h"
#include "sim/render/renderer.h"
#include "sim/scene/marker_view.h"
#include "tests/evidence/edge_spread.h"

namespace etalon {
namespace {

using std::numbers::pi;

CameraModel camera_with_lens(double wavelength_nm) {
    CameraModel camera;
    camera.width = 64;
    camera.height = 48;
    camera.intrinsics = {700.0, 500.0, 31.0, 23.0};
    camera.sensor = Sensor{.pixel_pitch_um = 6.0};
    camera.lens = Lens{2.8, 300.0, wavelength_nm, {}};
    return camera;
}

const std::vector<std::pair<double, double>> measured_profile{
    {0.0, 4.0}, {0.5, 3.0}, {1.25, 0.7}, {3.0, 0.2}};

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

TEST(Measured, IsSampledAsItsEnergyIs) {
    CameraModel camera = camera_with_lens(550.0);
    camera.lens->psf.kind = PointSpread::Kind::measured;
    camera.lens->psf.profile = measured_profile;
    const auto psf = PointSpreadFunction::of(camera);
    const PointSpreadSampler sampler(camera);
    for (const double energy : {0.0, 1e-6, 0.02, 0.3, 0.77, 0.999, 0.9999999})
        EXPECT_NEAR(psf.energy_within(sampler.radius_of(energy)), energy, 1e-5);
}

TEST(Measured, TakesThePlaceOfDefocus) {
    CameraModel camera = camera_with_lens(550.0);
    EXPECT_GT(aperture_of(camera).radius_mm, 0.0);
    EXPECT_GT(blur_radius_px(camera, 200.0), 0.0);
    camera.lens->psf.kind = PointSpread::Kind::measured;
    camera.lens->psf.profile = measured_profile;
    EXPECT_EQ(aperture_of(camera).radius_mm, 0.0);
    EXPECT_EQ(blur_radius_px(camera, 200.0), 0.0);
}

TEST(Measured, GivesAnEdgeTheProfileOfItsEnergyAtAnyDepth) {
    CameraModel camera = camera_with_lens(550.0);
    camera.lens->psf.kind = PointSpread::Kind::measured;
    camera.lens->psf.profile = measured_profile;
    const auto psf = PointSpreadFunction::measured(measured_profile);
    const auto profile =
        test::pixel_profile([&](double r) { return psf.energy_within(r); }, 6.0, 10);
    Scene scene{{PlacedMarker{}}};
    scene.markers[0].grid.cells = (cv::Mat_<float>(1, 2) << 0.0f, 1.0f);
    scene.markers[0].grid.cell_mm = {200.0, 400.0};
    scene.markers[0].camera_from_marker.translation = {0.0, 0.0, 200.0};
    // The edge at pixel 31.4: 0.4 px are 0.4 * 200 / 700 mm.
    scene.markers[0].grid.corner_mm = {0.4 * 200.0 / 700.0 - 200.0, -200.0};
    const auto image = Renderer(camera).render(scene).radiance;
    for (int x = 26; x < 37; ++x) {
        const auto i = static_cast<std::size_t>(std::lround((31.4 - x + 6.0) * 10.0));
        EXPECT_NEAR(image.at<float>(20, x), profile.value[i], 0.1 / 255.0) << x;
    }
}

}  // namespace
}  // namespace etalon
