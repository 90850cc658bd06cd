#include "sim/psf/diffraction.h"

#include "sim/tiles/image_filter.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

using std::numbers::pi;

CameraModel camera_with_lens(double wavelength_nm) {
    return test::camera_with_lens(64, 48, {700.0, 500.0, 31.0, 23.0}, {}, 6.0,
                                  {2.8, 300.0, wavelength_nm, {}});
}

TEST(Airy, HasItsFirstDarkRingAt122LambdaN) {
    const auto psf = PointSpreadFunction::airy(0.7);
    EXPECT_LT(psf.density(1.2196699 * 0.7), 1e-12 * psf.density(0.0));
    EXPECT_NEAR(psf.energy_within(1.2196699 * 0.7), 0.83778, 1e-5);  // Born and Wolf, 8.5.2
}

TEST(Airy, DensityIsTheDerivativeOfTheEncircledEnergy) {
    const auto psf = PointSpreadFunction::airy(0.7);
    for (const double r : {0.001, 0.3, 0.9, 4.0}) {
        const double h = 1e-5;
        const double slope = (psf.energy_within(r + h) - psf.energy_within(r - h)) / (2.0 * h);
        EXPECT_NEAR(psf.density(r) * 2.0 * pi * r, slope, 1e-6);
    }
}

TEST(Airy, LeavesTwoLambdaNOverPiSquaredRBeyondR) {
    const auto psf = PointSpreadFunction::airy(0.5);
    const double r = psf.radius_of_tail(0.004);
    EXPECT_NEAR(r, 2.0 * 0.5 / (pi * pi * 0.004), 1e-12);
    EXPECT_NEAR(1.0 - psf.energy_within(r), 0.004, 0.01 * 0.004);
}

TEST(Airy, WidthFollowsTheWorkingFNumber) {
    const CameraModel camera = camera_with_lens(550.0);
    const double v = 700.0 * 6e-3;
    const double f = 1.0 / (1.0 / 300.0 + 1.0 / v);
    const double working = 2.8 * v / f;
    EXPECT_NEAR(PointSpreadFunction::of(camera).scale_px(), 0.550 * working / 6.0, 1e-12);
}

TEST(Airy, RefusesAWavelengthThatIsNotPositive) {
    EXPECT_THROW(PointSpreadFunction::of(camera_with_lens(0.0)), NumericalError);
    EXPECT_THROW(PointSpreadFunction::of(camera_with_lens(std::nan(""))), NumericalError);
}

// Core and rings together hold all the energy, on a sensor with oblong pixels too: they end with a
// smooth window between a radius and its double.
TEST(ImageFilter, LevelsTogetherHoldAllEnergy) {
    const ImageFilter filter(camera_with_lens(550.0));
    const auto psf = PointSpreadFunction::of(camera_with_lens(550.0));
    for (const SampleKind kind : {SampleKind::point, SampleKind::box})
        for (const int k : {1, 3}) {
            double energy = filter.core(k, kind).energy;
            const int first = filter.first_ring();
            for (int shift = first; shift < first + 8; ++shift) {
                EXPECT_GT(energy, psf.energy_within(filter.radius_held(shift)));
                EXPECT_LT(energy, psf.energy_within(2.0 * filter.radius_held(shift)));
                energy += filter.ring(shift, false).energy;
            }
            EXPECT_NEAR(energy, 1.0, 2e-4);
        }
}

TEST(ImageFilter, ARingHoldsTheEnergyOfTheFinerOnesToo) {
    const ImageFilter filter(camera_with_lens(550.0));
    const int first = filter.first_ring();
    double energy = filter.ring(first, false).energy;
    for (int shift = first + 1; shift < first + 3; ++shift) {
        energy += filter.ring(shift, false).energy;
        EXPECT_NEAR(filter.ring(shift, true).energy, energy, 1e-9);
    }
}

TEST(ImageFilter, RefusesKernelsThatNoMemoryHolds) {
    CameraModel camera = camera_with_lens(550.0);
    camera.lens->wavelength_nm *= 110.0 / PointSpreadFunction::of(camera).scale_px();
    EXPECT_THROW(ImageFilter(camera).core(24, SampleKind::point), NumericalError);
}

TEST(ImageFilter, OfACameraWithoutLensIsThePixelsMean) {
    CameraModel camera = camera_with_lens(550.0);
    camera.lens.reset();
    const ImageFilter filter(camera);
    EXPECT_FALSE(filter.has_tail());
    const FilterKernel& core = filter.core(3, SampleKind::box);
    EXPECT_EQ(core.reach_x, 0);
    EXPECT_EQ(core.reach_y, 0);
    EXPECT_NEAR(core.energy, 1.0, 1e-12);
}

}  // namespace
}  // namespace etalon
