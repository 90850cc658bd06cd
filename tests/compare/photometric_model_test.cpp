#include "compare/photometric_model.h"

#include <gtest/gtest.h>

#include <limits>
#include <opencv2/imgproc.hpp>

#include "core/errors.h"
#include "core/random.h"
#include "sim/sensor_model.h"

namespace etalon {
namespace {

constexpr int width = 160, height = 120;
const cv::Mat everywhere(height, width, CV_8UC1, cv::Scalar(1));

// A slanted checkerboard of radiance 0 and 1, each pixel the average of 8 x 8 points.
Radiance checkerboard() {
    constexpr int fine = 8;
    Radiance image(height, width, CV_32FC1, cv::Scalar(0));
    for (int y = 0; y < height * fine; ++y)
        for (int x = 0; x < width * fine; ++x) {
            const double u = (x * 0.97 + y * 0.24) / fine / 17.0;
            const double v = (y * 0.97 - x * 0.24) / fine / 19.0;
            if ((static_cast<int>(std::floor(u)) + static_cast<int>(std::floor(v))) % 2 == 0)
                image.at<float>(y / fine, x / fine) += 1.0f / (fine * fine);
        }
    return image;
}

PhotometricModel some_model() {
    PhotometricModel model;
    model.black.head<3>() << 23.0, 7.0, -5.0;
    model.white.head<3>() << 201.0, -31.0, 17.0;
    model.psf_sigma_px = 0.83;
    return model;
}

void expect_levels(const PhotometricModel& fitted, const PhotometricModel& truth, double gray) {
    EXPECT_LT((fitted.black - truth.black).lpNorm<Eigen::Infinity>(), gray);
    EXPECT_LT((fitted.white - truth.white).lpNorm<Eigen::Infinity>(), gray);
}

TEST(PhotometricModel, PredictsBlackAndWhitePlanes) {
    const PhotometricModel model = some_model();
    Radiance flat(height, width, CV_32FC1, cv::Scalar(0));
    flat.at<float>(0, 0) = 0.0f;
    const cv::Mat dark = predicted_gray(model, flat, {});
    // Top left is half an image from the centre, less half a pixel: 159/320 and 119/240.
    EXPECT_NEAR(dark.at<float>(0, 0), 23.0 - 7.0 * 159 / 320 + 5.0 * 119 / 240, 1e-4);
    EXPECT_NEAR(dark.at<float>(height - 1, 0), 23.0 - 7.0 * 159 / 320 - 5.0 * 119 / 240, 1e-4);
    flat.setTo(1.0f);
    const cv::Mat light = predicted_gray(model, flat, {});
    EXPECT_NEAR(light.at<float>(0, width - 1), 201.0 - 31.0 * 159 / 320 - 17.0 * 119 / 240, 1e-4);
}

TEST(PhotometricModel, RecoversWhatAPhotographWasMadeWith) {
    const Radiance radiance = checkerboard();
    for (const double sigma : {0.0, 0.31, 0.83, 2.2}) {
        PhotometricModel truth = some_model();
        truth.psf_sigma_px = sigma;
        const cv::Mat photo = predicted_gray(truth, radiance, {});
        const PhotometricModel fitted = fit_photometric_model(photo, radiance, {}, everywhere, 1);
        EXPECT_NEAR(fitted.psf_sigma_px, sigma, sigma == 0.0 ? 0.05 : 0.005);
        expect_levels(fitted, truth, 0.05);
    }
}

TEST(PhotometricModel, TakesTheCamerasTransferCurveIntoAccount) {
    const Radiance radiance = checkerboard();
    const Transfer rec709{Transfer::Kind::rec709, {}};
    const PhotometricModel truth = some_model();
    const cv::Mat photo = predicted_gray(truth, radiance, rec709);
    EXPECT_GT(cv::norm(photo, predicted_gray(truth, radiance, {}), cv::NORM_INF), 10.0);
    const PhotometricModel fitted = fit_photometric_model(photo, radiance, rec709, everywhere, 1);
    EXPECT_NEAR(fitted.psf_sigma_px, truth.psf_sigma_px, 0.005);
    expect_levels(fitted, truth, 0.05);
}

// A corner shows something else, as with a finger or a lamp. Plain least squares moves the levels
// by more than twice the tolerance.
TEST(PhotometricModel, IsNotPulledAwayByAFingerOnTheBoard) {
    const Radiance radiance = checkerboard();
    const PhotometricModel truth = some_model();
    cv::Mat photo = predicted_gray(truth, radiance, {});
    RandomStream random(5, 1);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            photo.at<float>(y, x) += static_cast<float>(random.normal());
    photo(cv::Rect(0, 0, 12, 30)).setTo(90.0f);
    const PhotometricModel fitted = fit_photometric_model(photo, radiance, {}, everywhere, 1);
    expect_levels(fitted, truth, 4.0);
    EXPECT_NEAR(fitted.psf_sigma_px, truth.psf_sigma_px, 0.05);
}

// Noise of 4 gray on n = 19 200 pixels, about half of them of each colour: a plane's centre level
// has a standard deviation near 4 / sqrt(9600) = 0.041 gray and its slopes sqrt(12) times that,
// 0.14; with six of them and 3.5 standard deviations each, 0.5 gray.
TEST(PhotometricModel, AveragesNoiseAway) {
    const Radiance radiance = checkerboard();
    const PhotometricModel truth = some_model();
    cv::Mat photo = predicted_gray(truth, radiance, {});
    RandomStream random(17, 2);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            photo.at<float>(y, x) += static_cast<float>(4.0 * random.normal());
    expect_levels(fit_photometric_model(photo, radiance, {}, everywhere, 1), truth, 0.5);
}

TEST(PhotometricModel, FitsOnlyThePixelsItIsGiven) {
    const Radiance radiance = checkerboard();
    const PhotometricModel truth = some_model();
    cv::Mat photo = predicted_gray(truth, radiance, {});
    cv::Mat use = everywhere.clone();
    use(cv::Rect(80, 0, 80, height)).setTo(2);
    photo(cv::Rect(80, 0, 80, height)).setTo(std::numeric_limits<float>::quiet_NaN());
    const PhotometricModel fitted = fit_photometric_model(photo, radiance, {}, use, 1);
    EXPECT_EQ(fitted.pixels, 80 * height);
    expect_levels(fitted, truth, 0.1);
}

TEST(PhotometricModel, RefusesWhatDoesNotDetermineIt) {
    const Radiance radiance = checkerboard();
    const cv::Mat photo = predicted_gray(some_model(), radiance, {});
    const cv::Mat nowhere = cv::Mat::zeros(height, width, CV_8UC1);
    EXPECT_THROW(fit_photometric_model(photo, radiance, {}, nowhere, 1), NumericalError);
    const Radiance dark = cv::Mat::zeros(height, width, CV_32FC1);
    EXPECT_THROW(fit_photometric_model(photo, dark, {}, everywhere, 1), NumericalError);
    cv::Mat line = nowhere.clone();
    line.row(60).setTo(1);
    EXPECT_THROW(fit_photometric_model(photo, radiance, {}, line, 1), NumericalError);
    cv::Mat broken = photo.clone();
    broken.at<float>(50, 50) = std::numeric_limits<float>::quiet_NaN();
    EXPECT_THROW(fit_photometric_model(broken, radiance, {}, everywhere, 1), NumericalError);
    EXPECT_THROW(fit_photometric_model(photo(cv::Rect(0, 0, 50, 50)), radiance, {}, everywhere, 1),
                 NumericalError);
}

TEST(GrayOf, ScalesEveryBitDepthTo255) {
    const cv::Mat eight(1, 1, CV_8UC1, cv::Scalar(51));
    EXPECT_NEAR(gray_of({eight, 8}).at<float>(0), 51.0, 1e-4);
    const cv::Mat twelve(1, 1, CV_16UC1, cv::Scalar(819));
    EXPECT_NEAR(gray_of({twelve, 12}).at<float>(0), 51.0, 1e-4);
}

// The second moment of the impulse response is the variance asked for, at every width.
TEST(Blurred, HasExactlyTheVarianceAskedForAndKeepsTheSum) {
    for (const double sigma : {0.0, 0.2, 0.5, 0.83, 1.7, 3.0}) {
        cv::Mat impulse = cv::Mat::zeros(61, 61, CV_64FC1);
        impulse.at<double>(30, 30) = 1.0;
        const cv::Mat response = blurred(impulse, sigma);
        double sum = 0, moment = 0;
        for (int y = 0; y < 61; ++y)
            for (int x = 0; x < 61; ++x) {
                sum += response.at<double>(y, x);
                moment += response.at<double>(y, x) * (x - 30) * (x - 30);
            }
        EXPECT_NEAR(sum, 1.0, 1e-9);
        EXPECT_NEAR(moment, sigma * sigma, 1e-4 * (sigma * sigma + 0.01)) << "sigma " << sigma;
    }
}

}  // namespace
}  // namespace etalon
