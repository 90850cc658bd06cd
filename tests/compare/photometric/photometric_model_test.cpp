#include "compare/photometric/photometric_model.h"

#include "sim/sensor/sensor_model.h"
#include "tests/calib/cameras.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr int width = 160, height = 120;

PhotometricModel some_model() {
    PhotometricModel model;
    model.black.head<3>() << 23.0, 7.0, -5.0;
    model.white.head<3>() << 201.0, -31.0, 17.0;
    model.psf_sigma_px = 0.83;
    return model;
}

TEST(PhotometricModel, PredictsBlackAndWhitePlanes) {
    const PhotometricModel model = some_model();
    Radiance flat(height, width, CV_32FC1, cv::Scalar(0));
    const cv::Mat dark = predicted_gray(model, flat, {});
    // Top left is half an image from the centre, less half a pixel: 159/320 and 119/240.
    EXPECT_NEAR(dark.at<float>(0, 0), 23.0 - 7.0 * 159 / 320 + 5.0 * 119 / 240, 1e-4);
    EXPECT_NEAR(dark.at<float>(height - 1, 0), 23.0 - 7.0 * 159 / 320 - 5.0 * 119 / 240, 1e-4);
    flat.setTo(1.0f);
    const cv::Mat light = predicted_gray(model, flat, {});
    EXPECT_NEAR(light.at<float>(0, width - 1), 201.0 - 31.0 * 159 / 320 - 17.0 * 119 / 240, 1e-4);
}

// A camera with a black level of 8 sees black at 23 and white at 201 of 255: on Rec. 709's straight
// toe (below 0.081) and on its power. Half of that light is neither's half.
TEST(PhotometricModel, TakesTheCamerasTransferCurveBetweenItsOwnLevels) {
    PhotometricModel model = some_model();
    model.psf_sigma_px = 0.0;
    model.black.tail<5>().setZero();
    model.white.tail<5>().setZero();
    const Radiance half(height, width, CV_32FC1, cv::Scalar(0.5));
    Sensor sensor;
    sensor.transfer.kind = Transfer::Kind::rec709;
    sensor.black_dn = 8.0;
    const double dark = 15.0 / 247.0 / 4.5;
    const double light = std::pow((193.0 / 247.0 + 0.099) / 1.099, 1.0 / 0.45);
    const double expected = 8.0 + 247.0 * (1.099 * std::pow(0.5 * (dark + light), 0.45) - 0.099);
    const cv::Mat seen = predicted_gray(model, half, {sensor, model});
    EXPECT_NEAR(seen.at<float>(60, 80), expected, 1e-3);
    EXPECT_GT(std::abs(expected - (23.0 + 178.0 * (1.099 * std::pow(0.5, 0.45) - 0.099))), 0.5)
        << "what a curve between 0 and 1 would give";
}

TEST(LightCurve, RunsFromBlackToWhiteWithItsOwnSlope) {
    Sensor sensor;
    sensor.transfer.kind = Transfer::Kind::rec709;
    const PhotometricModel model = some_model();
    const LightCurve curve(sensor, model);
    EXPECT_NEAR(curve.value(0.0), 0.0, 1e-12);
    EXPECT_NEAR(curve.value(1.0), 1.0, 1e-12);
    for (const double radiance : {-0.02, 0.3, 0.7}) {
        const double slope = (curve.value(radiance + 1e-3) - curve.value(radiance - 1e-3)) / 2e-3;
        EXPECT_NEAR(curve.at(radiance).slope, slope, 1e-3);
    }
    EXPECT_EQ(LightCurve().value(0.37), 0.37);
    EXPECT_EQ(LightCurve(std::nullopt, model).value(0.37), 0.37);
}

TEST(PhotometricModel, SaysHowGrayChangesWithWhatIsSeen) {
    PhotometricModel model = some_model();
    model.tone = 0.3;
    model.saturation = Saturation{190.0, 12.0};
    const Vector6d terms = level_terms(31.0, 90.0, {width, height});
    constexpr double step = 1e-5;
    for (const double seen : {0.0, 0.4, 0.8, 0.95, 1.0}) {
        const double slope =
            (model.at(terms, seen + step).gray - model.at(terms, seen - step).gray) / (2 * step);
        EXPECT_NEAR(model.at(terms, seen).by_seen, slope, 1e-4) << "seen " << seen;
    }
}

// The expectation of min(gray + n, level) as a sum over n, and its derivatives from differences.
double clipped_mean(double gray, double level, double knee) {
    constexpr int steps = 40000;
    double sum = 0.0, weights = 0.0;
    for (int i = -steps; i <= steps; ++i) {
        const double z = 10.0 * i / steps, weight = std::exp(-0.5 * z * z);
        sum += weight * std::min(gray + knee * z, level);
        weights += weight;
    }
    return sum / weights;
}

TEST(Saturation, IsTheMeanOfAClippedNormal) {
    constexpr double level = 246.0, knee = 17.0, step = 0.01;
    for (const double gray : {40.0, 180.0, 215.0, 243.0, 246.0, 271.0, 330.0, 500.0}) {
        const Saturation::Point point = Saturation{level, knee}.at(gray);
        const auto change = [&](double by_gray, double by_level, double by_knee) {
            return (clipped_mean(gray + by_gray, level + by_level, knee + by_knee) -
                    clipped_mean(gray - by_gray, level - by_level, knee - by_knee)) /
                   (2.0 * step);
        };
        EXPECT_NEAR(point.gray, clipped_mean(gray, level, knee), 1e-4);
        EXPECT_NEAR(point.slope, change(step, 0, 0), 1e-4) << "gray " << gray;
        EXPECT_NEAR(point.by_level, change(0, step, 0), 1e-4) << "gray " << gray;
        EXPECT_NEAR(point.by_knee, change(0, 0, step), 1e-4) << "gray " << gray;
    }
}

TEST(GrayOf, ScalesEveryBitDepthTo255) {
    const cv::Mat eight(1, 1, CV_8UC1, cv::Scalar(51));
    EXPECT_NEAR(gray_of({eight, 8}).at<float>(0), 51.0, 1e-4);
    const cv::Mat twelve(1, 1, CV_16UC1, cv::Scalar(819));
    EXPECT_NEAR(gray_of({twelve, 12}).at<float>(0), 51.0, 1e-4);
}

// Of the impulse response of blurred(): the sum, the second moments along x and y, the fourth
// along x.
template <class Sigma>
Eigen::Vector4d moments(const Sigma& sigma) {
    cv::Mat impulse = cv::Mat::zeros(61, 61, CV_64FC1);
    impulse.at<double>(30, 30) = 1.0;
    const cv::Mat response = blurred(impulse, sigma);
    Eigen::Vector4d sums = Eigen::Vector4d::Zero();
    for (int y = -30; y <= 30; ++y)
        for (int x = -30; x <= 30; ++x)
            sums += response.at<double>(y + 30, x + 30) *
                    Eigen::Vector4d(1, x * x, y * y, std::pow(x, 4));
    return sums;
}

TEST(Blurred, MayDifferAlongXAndY) {
    PhotometricModel model;
    model.psf_sigma_px = 1.1;
    model.psf_anisotropy_px2 = 0.35;
    const Eigen::Vector4d found = moments(model.psf_sigmas_px());
    EXPECT_NEAR(found[1], 1.21 + 0.35, 1e-3);
    EXPECT_NEAR(found[2], 1.21 - 0.35, 1e-3);
}

// The moments of the impulse response are a Gaussian's of the variance asked for, at every width.
TEST(Blurred, HasExactlyTheVarianceAskedForAndKeepsTheSum) {
    for (const double sigma : {0.0, 0.2, 0.5, 0.83, 1.7, 3.0}) {
        const Eigen::Vector4d found = moments(sigma);
        EXPECT_NEAR(found[0], 1.0, 1e-9);
        EXPECT_NEAR(found[3], 3.0 * std::pow(sigma, 4), 1e-3 * (3.0 * std::pow(sigma, 4) + 0.01));
        EXPECT_NEAR(found[1], sigma * sigma, 1e-4 * (sigma * sigma + 0.01)) << "sigma " << sigma;
    }
}

constexpr double pi = std::numbers::pi;

// The mean code: truth is the uniform quantiser's Fourier series, and the sensor itself with its
// noise drawn. Without a curve and nearly without shot noise: sigma in codes is the read noise's.
Sensor steady_sensor(double sigma_codes, double black) {
    return {.black_dn = black, .gain_e_per_dn = 1e7, .read_noise_e = sigma_codes * 1e7};
}

// Widrow and Kollar: the mean of a rounded normal variable.
double rounded_mean(double code, double sigma) {
    double mean = code;
    for (int n = 1; n < 40; ++n)
        mean += (n % 2 ? -1.0 : 1.0) / (pi * n) * std::sin(2.0 * pi * n * code) *
                std::exp(-2.0 * pi * pi * n * n * sigma * sigma);
    return mean;
}

TEST(MeanCode, IsThatOfTheUniformQuantisersSeries) {
    for (const double sigma : {0.12, 0.17, 0.31, 0.9}) {
        const MeanCode mean(steady_sensor(sigma, 7.3));
        for (const double code : {41.0, 41.21, 41.5, 41.83, 126.37})
            EXPECT_NEAR(mean.at(code).gray, rounded_mean(code, sigma), 0.008) << sigma;
    }
    EXPECT_NEAR(rounded_mean(41.21, 0.17), 41.05, 0.01) << "the bias that is meant";
}

TEST(MeanCode, SlopesAsItRises) {
    const MeanCode mean(steady_sensor(0.17, 7.3));
    constexpr double step = 0.01;
    for (double gray = -3.03; gray < 260.0; gray += 0.177) {
        const MeanCode::Point at = mean.at(gray);
        EXPECT_GE(at.slope, 0.0);
        const double chord = (mean.at(gray + step).gray - mean.at(gray - step).gray) / (2 * step);
        EXPECT_NEAR(at.slope, chord, 0.35) << gray;  // a kink of the table's may lie between
    }
}

// 10 bits behind a curve, with black at 0, where half of the noise is cut off, and white at the
// end.
TEST(MeanCode, IsTheMeanOfWhatTheSensorDraws) {
    CameraModel camera = test::camera_with(1000, 800, {});
    Sensor& sensor = camera.sensor.emplace(Sensor{
        .transfer = {Transfer::Kind::rec709, {}}, .gain_e_per_dn = 60.0, .read_noise_e = 10.0});
    for (const int bits : {8, 10}) {
        sensor.bits = bits;
        const SensorModel model(camera);
        const MeanCode mean(sensor);
        std::uint64_t seed = 3;
        for (const double radiance : {0.0, 0.00071, 0.0213, 0.17, 0.77, 0.9999}) {
            const Radiance even(camera.height, camera.width, CV_32FC1, cv::Scalar(radiance));
            const cv::Mat codes = gray_of(model.expose(even, NoiseKey{seed++, 0}));
            cv::Scalar found, scatter;
            cv::meanStdDev(codes, found, scatter);
            const double standard_error = scatter[0] / std::sqrt(codes.total());
            EXPECT_NEAR(mean.at(255.0 * encode(sensor.transfer, radiance)).gray, found[0],
                        4.0 * standard_error + 0.002)
                << bits << " bits, " << radiance;
        }
    }
}

TEST(MeanCode, ChangesWithTheStatedNoise) {
    constexpr double more = 0.01;
    const MeanCode mean(steady_sensor(0.2, 7.3)), noisier(steady_sensor(0.2 * (1.0 + more), 7.3));
    for (const double gray : {7.3, 41.21, 126.83, 254.9}) {
        const double change = (noisier.at(gray).gray - mean.at(gray).gray) / more;
        EXPECT_NEAR(mean.at(gray).by_log_noise, change, 0.02 * std::abs(change) + 1e-6);
        EXPECT_GT(std::abs(change), 0.01);
    }
}

TEST(MeanCode, IsTheLightsOwnWhereNoNoiseIsStatedAndWhereCodesAreFine) {
    Sensor silent, fine = steady_sensor(0.2, 7.3);
    fine.bits = 12;
    for (const Sensor& sensor : {silent, fine}) {
        const MeanCode::Point at = MeanCode(sensor).at(41.21);
        EXPECT_EQ(at.gray, 41.21);
        EXPECT_EQ(at.slope, 1.0);
        EXPECT_EQ(at.by_log_noise, 0.0);
    }
}

// Hardly any noise: a step would have no slope for a fit to follow.
TEST(MeanCode, IsNoStaircase) {
    const MeanCode mean(steady_sensor(1e-4, 0.0));
    for (double gray = 3.0; gray < 4.0; gray += 0.01)
        EXPECT_NEAR(mean.at(gray).gray, rounded_mean(gray, 0.1), 0.02);
}

}  // namespace
}  // namespace etalon
