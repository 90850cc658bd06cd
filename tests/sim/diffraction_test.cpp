#include "sim/diffraction.h"

#include <gtest/gtest.h>

#include <numbers>

#include "core/errors.h"
#include "sim/image_filter.h"

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

// Core, near and far tail together hold all the energy; so do they on a sensor with oblong pixels.
TEST(ImageFilter, LevelsTogetherHoldAllEnergy) {
    const ImageFilter filter(camera_with_lens(550.0));
    const double reach = 2000.0;
    const double tail = cv::sum(filter.near_kernel())[0] + cv::sum(filter.far_kernel(reach))[0];
    const double beyond =
        1.0 - PointSpreadFunction::of(camera_with_lens(550.0)).energy_within(reach);
    for (const SampleKind kind : {SampleKind::point, SampleKind::box})
        for (const int k : {1, 3}) {
            const double core = cv::sum(filter.core(k, kind).weights)[0];
            EXPECT_NEAR(core + tail + beyond, 1.0, 2e-4) << k;
        }
}

TEST(ImageFilter, OfACameraWithoutLensIsThePixelsMean) {
    CameraModel camera = camera_with_lens(550.0);
    camera.lens.reset();
    const ImageFilter filter(camera);
    EXPECT_FALSE(filter.has_near_tail());
    const CoreKernel& core = filter.core(3, SampleKind::box);
    EXPECT_EQ(core.weights.size(), cv::Size(3, 3));
    EXPECT_NEAR(cv::sum(core.weights)[0], 1.0, 1e-6);
}

TEST(Convolve, IsTheSumOverTheKernel) {
    cv::Mat image = cv::Mat::zeros(9, 14, CV_32FC1), kernel(3, 5, CV_32FC1);
    cv::randu(kernel, 0.0, 1.0);
    image.at<float>(4, 6) = 2.0f;
    image.at<float>(8, 13) = 3.0f;  // the kernel hangs over the border
    const cv::Mat result = convolve(image, kernel);
    for (int y = -1; y <= 1; ++y)
        for (int x = -2; x <= 2; ++x)
            EXPECT_NEAR(result.at<float>(4 + y, 6 + x), 2.0f * kernel.at<float>(1 + y, 2 + x),
                        1e-5);
    EXPECT_NEAR(result.at<float>(7, 11), 3.0f * kernel.at<float>(0, 0), 1e-5);
    EXPECT_NEAR(result.at<float>(0, 0), 0.0f, 1e-5);
}

}  // namespace
}  // namespace etalon
