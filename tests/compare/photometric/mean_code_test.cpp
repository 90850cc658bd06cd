// Truth: the uniform quantiser's Fourier series, and the sensor itself with its noise drawn.
#include "compare/photometric/photometric_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/sensor/sensor_model.h"

namespace etalon {
namespace {

constexpr double pi = std::numbers::pi;

// Without a curve and nearly without shot noise: sigma in codes is the read noise's.
Sensor steady_sensor(double sigma_codes, double black) {
    Sensor sensor;
    sensor.black_dn = black;
    sensor.gain_e_per_dn = 1e7;
    sensor.read_noise_e = sigma_codes * 1e7;
    return sensor;
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
    CameraModel camera;
    camera.width = 1000;
    camera.height = 800;
    camera.sensor.emplace();
    Sensor& sensor = *camera.sensor;
    sensor.transfer.kind = Transfer::Kind::rec709;
    sensor.gain_e_per_dn = 60.0;
    sensor.read_noise_e = 10.0;
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
