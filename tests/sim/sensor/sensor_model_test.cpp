#include "sim/sensor/sensor_model.h"

#include <random>

#include "core/statistics/random.h"
#include "sim/sensor/sensor_simd.h"
#include "tests/calib/cameras.h"
#include "tests/sim/every_target.h"

namespace etalon {
namespace {

CameraModel camera_of(int width, int height) {
    return test::camera_with(width, height, {100.0, 140.0, 3.0, 2.0}, {});
}

CameraModel camera_of_sensor(const Sensor& sensor, int width = 7, int height = 5) {
    CameraModel camera = camera_of(width, height);
    camera.sensor = sensor;
    return camera;
}

Radiance uniform(double radiance, int width = 7, int height = 5) {
    return Radiance(height, width, CV_32FC1, cv::Scalar::all(radiance));
}

int first_code(const CodeImage& image) {
    return image.bits > 8 ? image.pixels.at<std::uint16_t>(0, 0)
                          : image.pixels.at<std::uint8_t>(0, 0);
}

int code_for(const Sensor& sensor, double radiance) {
    return first_code(SensorModel(camera_of_sensor(sensor)).expose(uniform(radiance)));
}

TEST(SensorModel, WithoutASensorSectionIsEightBitsLinearAndRoundsHalfUp) {
    const SensorModel sensor(camera_of(7, 5));
    // 0.1 * 255 = 25.5 exactly in the real numbers; the float 0.1f lies 1.5e-9 above.
    for (const auto& [radiance, code] : {std::pair{0.0, 0}, {0.1, 26}, {0.0979, 25}, {1.0, 255}})
        EXPECT_EQ(first_code(sensor.expose(uniform(radiance))), code) << radiance;
    EXPECT_EQ(first_code(sensor.expose(uniform(0.5))), 128);  // 127.5, exact in binary
}

TEST(SensorModel, ReachesFullScaleAtEveryBitDepth) {
    for (int bits = 1; bits <= 16; ++bits) {
        Sensor sensor{.bits = bits};
        EXPECT_EQ(code_for(sensor, 1.0), (1 << bits) - 1);
        EXPECT_EQ(code_for(sensor, 0.0), 0);
        EXPECT_EQ(code_for(sensor, 0.5), (1 << (bits - 1)));  // (2^b - 1) / 2, half up
        const CodeImage image = SensorModel(camera_of_sensor(sensor)).expose(uniform(0.3));
        EXPECT_EQ(image.pixels.type(), bits > 8 ? CV_16UC1 : CV_8UC1);
        EXPECT_EQ(image.bits, bits);
    }
}

TEST(Rec709, HasTheStandardsValuesAroundItsBreak) {
    const Transfer curve{Transfer::Kind::rec709, {}};
    EXPECT_DOUBLE_EQ(encode(curve, 0.0), 0.0);
    EXPECT_NEAR(encode(curve, 0.018 - 1e-12), 0.081, 1e-9);  // 4.5 * 0.018
    // 0.018^0.45 = exp(0.45 ln 0.018) = exp(-1.807823) = 0.164011
    EXPECT_NEAR(encode(curve, 0.018), 1.099 * 0.164011 - 0.099, 1e-6);
    EXPECT_NEAR(encode(curve, 0.5), 1.099 * 0.7320428 - 0.099, 1e-6);  // 2^-0.45
    EXPECT_NEAR(encode(curve, 1.0), 1.0, 1e-15);
    EXPECT_DOUBLE_EQ(decode(curve, 0.0811), 0.018);  // in the gap between the branches
    EXPECT_DOUBLE_EQ(encode(curve, -0.01), -0.045);
}

TEST(Transfer, IsInvertedByDecode) {
    const Transfer table{Transfer::Kind::table, {{0.0, 0.02}, {0.3, 0.5}, {1.0, 0.9}}};
    for (const Transfer& curve : {Transfer{}, Transfer{Transfer::Kind::rec709, {}}, table}) {
        for (const double radiance : {-0.03, 0.0, 0.007, 0.0179, 0.0181, 0.3, 0.77, 1.0})
            EXPECT_NEAR(decode(curve, encode(curve, radiance)), radiance, 1e-12);
    }
    EXPECT_DOUBLE_EQ(encode(table, 0.15), 0.26);
    EXPECT_DOUBLE_EQ(encode(table, 0.65), 0.7);
    EXPECT_DOUBLE_EQ(encode(table, 1.5), 0.9);
}

TEST(SensorModel, TakesCodesBackToTheRadianceTheyCameFrom) {
    for (const auto kind : {Transfer::Kind::linear, Transfer::Kind::rec709}) {
        Sensor sensor{.bits = 10, .black_dn = 40.0};
        sensor.transfer.kind = kind;
        const SensorModel model(camera_of_sensor(sensor, 50, 1));
        Radiance radiance(1, 50, CV_32FC1);
        for (int x = 0; x < 50; ++x)
            radiance.at<float>(0, x) = static_cast<float>(x / 49.0);
        const Radiance back = model.linear_radiance(model.expose(radiance));
        // Half a code of 983, over the curve's least slope (0.45 * 1.099 = 0.4946 at white).
        const double tolerance = 0.5 / 983.0 / (kind == Transfer::Kind::linear ? 1.0 : 0.4945);
        EXPECT_LE(cv::norm(back, radiance, cv::NORM_INF), tolerance + 1e-6);
    }
}

TEST(SensorModel, DarkensWithTheFourthPowerOfTheCosine) {
    Sensor sensor;
    sensor.illumination.kind = Illumination::Kind::cos4;
    sensor.bits = 16;
    const SensorModel model(camera_of_sensor(sensor));
    // Pixel (7-1, 5-1) is 3 px right and 2 px below the principal point: x = 0.03, y = 2/140.
    const double r2 = 0.03 * 0.03 + (2.0 / 140.0) * (2.0 / 140.0);
    EXPECT_NEAR(model.relative_response().at<float>(4, 6), 1.0 / ((1 + r2) * (1 + r2)), 1e-7);
    EXPECT_EQ(model.relative_response().at<float>(2, 3), 1.0f);
    const CodeImage image = model.expose(uniform(0.8));
    EXPECT_EQ(image.pixels.at<std::uint16_t>(4, 6),
              std::floor(0.8f * 65535.0 / ((1 + r2) * (1 + r2)) + 0.5));
}

TEST(SensorNoise, IsTheSameForTheSameKeyAndAnotherForTheNextFrameOrSeed) {
    Sensor sensor{.gain_e_per_dn = 3.0};
    const SensorModel model(camera_of_sensor(sensor));
    const auto shot = [&](std::optional<NoiseKey> key) {
        return model.expose(uniform(0.6), key).pixels;
    };
    EXPECT_EQ(cv::countNonZero(shot(NoiseKey{7, 5}) != shot(NoiseKey{7, 5})), 0);
    EXPECT_GT(cv::countNonZero(shot(NoiseKey{7, 5}) != shot(NoiseKey{7, 6})), 20);
    EXPECT_GT(cv::countNonZero(shot(NoiseKey{7, 5}) != shot(NoiseKey{8, 5})), 20);
    EXPECT_EQ(cv::countNonZero(shot({}) != 153), 0);  // 0.6 * 255
}

// The formula of sim/sensor/sensor_simd.h, one pixel at a time. From none to more than two
// stretches of any vector, at places of every alignment of a double; the neighbours stay. Pixel
// numbers pass 2^32, the key has bits in both halves.
TEST(SensorNoise, IsThatOfTheScalarFormulaBitForBitOnEveryInstructionSet) {
    const SensorNoise noise{0.0037, 0.00021};
    const NoiseKey key{0x9e3779b97f4a7c15, 0xfedcba98};
    on_every_target([&] {
        for (int count = 0; count < 150; ++count) {
            const int begin = count % 9;
            const std::uint64_t pixel = 0xffffffff - 60 + std::uint64_t(count) / 3;
            std::vector<double> signals;
            for (int x = 0; x < begin + count + 9; ++x)
                signals.push_back(0.011 * x - 0.3);
            std::vector<double> expected = signals;
            for (int x = 0; x < count; ++x) {
                double& signal = expected[static_cast<std::size_t>(begin + x)];
                const double variance =
                    std::max(signal, 0.0) * noise.shot_variance + noise.read_variance;
                const auto number = pixel + static_cast<std::uint64_t>(x);
                signal += std::sqrt(variance) * RandomStream(key.seed, key.frame, number).normal();
            }
            add_noise(noise, key, pixel, count, signals.data() + begin);
            ASSERT_EQ(signals, expected) << count;
        }
    });
}

// Neighbours and the next frame are independent: a correlation's standard error is 1 / sqrt(n).
TEST(SensorNoise, IsWithoutCorrelationAlongTheRowAndFromFrameToFrame) {
    const int n = 200'000;
    std::vector<double> first(n, 0.0), next(n, 0.0);
    add_noise({0.0, 1.0}, {7, 0}, 0, n, first.data());
    add_noise({0.0, 1.0}, {7, 1}, 0, n, next.data());
    const auto expect_none = [&](const std::vector<double>& other, std::size_t lag) {
        double product = 0.0;
        for (std::size_t x = lag; x < n; ++x)
            product += other[x] * first[x - lag] / n;
        EXPECT_NEAR(product, 0.0, 4.5 / std::sqrt(double(n))) << lag;
    };
    for (const std::size_t lag : {1u, 2u, 4u, 8u, 64u, 640u})
        expect_none(first, lag);
    expect_none(next, 0);
}

TEST(SensorModel, RefusesRadianceThatIsNotItsSize) {
    const SensorModel model(camera_of(7, 5));
    EXPECT_THROW(model.expose(uniform(0.5, 5, 7)), NumericalError);
    EXPECT_THROW(model.expose(Radiance()), NumericalError);
    EXPECT_THROW(model.linear_radiance({cv::Mat(5, 7, CV_16UC1), 12}), NumericalError);
}

// The formula of sim/sensor/sensor_model.h, one pixel at a time.
int documented_code(const Sensor& sensor, double signal) {
    const double full_scale = (1 << sensor.bits) - 1;
    const double code =
        sensor.black_dn + (full_scale - sensor.black_dn) * encode(sensor.transfer, signal);
    return static_cast<int>(std::clamp(std::floor(code + 0.5), 0.0, full_scale));
}

// Every code's rounding boundary, at most 200 of them: the floats around it, at a pixel of that
// response. Then what a sensor does not expect.
std::vector<float> awkward_radiances(const Sensor& sensor, float response) {
    const int full_scale = (1 << sensor.bits) - 1;
    std::vector<float> radiances{-0.0f, 1e-42f, -1e-42f, 1.0f, 1.7f, -0.3f, 3e38f, -3e38f};
    for (int code = 1; code <= full_scale; code += 1 + full_scale / 200) {
        const double fraction = (code - 0.5 - sensor.black_dn) / (full_scale - sensor.black_dn);
        auto at = static_cast<float>(decode(sensor.transfer, fraction) / response);
        at = std::nextafter(std::nextafter(at, -9.0f), -9.0f);
        for (int n = 0; n < 5; ++n, at = std::nextafter(at, 9.0f))
            radiances.push_back(at);
    }
    return radiances;
}

void expect_documented_codes(const Sensor& sensor, float red) {
    const std::vector<float> values = awkward_radiances(sensor, red);
    CameraModel camera = camera_of_sensor(sensor, 2 * static_cast<int>(values.size()), 1);
    camera.sensor->mosaic = Mosaic::rggb;  // red is every other pixel of the first row
    camera.sensor->channel_response = {red, 1.0, 1.0};
    Radiance radiance(1, camera.width, CV_32FC1);
    for (int x = 0; x < camera.width; ++x)
        radiance.at<float>(0, x) = values[static_cast<std::size_t>(x / 2)];
    cv::Mat codes;
    SensorModel(camera).expose(radiance).pixels.convertTo(codes, CV_32S);
    for (int x = 0; x < camera.width; ++x) {
        const double signal = double(radiance.at<float>(0, x)) * (x % 2 == 0 ? red : 1.0f);
        ASSERT_EQ(codes.at<int>(0, x), documented_code(sensor, signal))
            << radiance.at<float>(0, x) << " at pixel " << x;
    }
}

TEST(SensorModel, GivesTheDocumentedCodeAroundEveryRoundingBoundary) {
    const Transfer table{Transfer::Kind::table,
                         {{0.0, 0.02}, {0.1, 0.6}, {0.3, 0.6001}, {0.301, 0.7}, {1.0, 0.9}}};
    on_every_target([&] {
        for (const Transfer& transfer : {Transfer{}, {Transfer::Kind::rec709, {}}, table})
            for (const int bits : {1, 3, 8, 12, 16})
                for (const double black : {0.0, 0.37})
                    for (const float red : {1.0f, 0.71f}) {
                        SCOPED_TRACE(fmt::format("{} bits, black {}, {}", bits, black, red));
                        Sensor sensor{.bits = bits, .black_dn = black * ((1 << bits) - 1)};
                        sensor.transfer = transfer;
                        expect_documented_codes(sensor, red);
                    }
    });
}

// Of the deviate that the pixel's own stream gives: no pixel depends on its place in a vector.
void expect_documented_noise(const Sensor& sensor, const NoiseKey& key) {
    const CameraModel camera = camera_of_sensor(sensor, 301, 3);
    Radiance radiance(3, 301, CV_32FC1);
    for (int y = 0; y < 3; ++y)
        for (int x = 0; x < 301; ++x)
            radiance.at<float>(y, x) = static_cast<float>(0.004 * x - 0.02 * y);
    cv::Mat codes;
    SensorModel(camera).expose(radiance, key).pixels.convertTo(codes, CV_32S);
    const double range = (1 << sensor.bits) - 1 - sensor.black_dn;
    for (int y = 0; y < 3; ++y)
        for (int x = 0; x < 301; ++x) {
            const double signal = range * radiance.at<float>(y, x);
            const double read_dn = sensor.read_noise_e / sensor.gain_e_per_dn;
            const double sigma =
                std::sqrt(std::max(signal, 0.0) / sensor.gain_e_per_dn + read_dn * read_dn);
            const auto pixel = static_cast<std::uint64_t>(301 * y + x);
            const double noise = sigma * RandomStream(key.seed, key.frame, pixel).normal();
            ASSERT_EQ(codes.at<int>(y, x), documented_code(sensor, (signal + noise) / range))
                << x << " " << y;
        }
}

TEST(SensorNoise, GivesEveryPixelTheDocumentedCode) {
    on_every_target([] {
        for (const auto kind : {Transfer::Kind::linear, Transfer::Kind::rec709})
            for (const int bits : {8, 12, 16})
                for (const double black : {0.0, 0.05}) {
                    SCOPED_TRACE(fmt::format("{} bits, black {}", bits, black));
                    const double full_scale = (1 << bits) - 1;
                    Sensor sensor{.bits = bits,
                                  .black_dn = black * full_scale,
                                  .gain_e_per_dn = 9000.0 / full_scale,
                                  .read_noise_e = 70.0};
                    sensor.transfer.kind = kind;
                    expect_documented_noise(sensor, {23, 6});
                }
    });
}

// 1 / (gain times range) overflows: no light has no photon noise, light is saturated or black.
TEST(SensorNoise, LeavesACodeAtTheLeastGain) {
    for (const auto kind : {Transfer::Kind::linear, Transfer::Kind::rec709}) {
        Sensor sensor{.gain_e_per_dn = 5e-324};
        sensor.transfer.kind = kind;
        const NoiseKey key{1, 1};
        const cv::Mat dark = SensorModel(camera_of_sensor(sensor)).expose(uniform(0.0), key).pixels;
        EXPECT_EQ(cv::countNonZero(dark), 0);
        const auto expect_extremes = [&](double radiance) {
            const cv::Mat lit =
                SensorModel(camera_of_sensor(sensor)).expose(uniform(radiance), key).pixels;
            EXPECT_EQ(cv::countNonZero(lit == 0) + cv::countNonZero(lit == 255), 35);
            EXPECT_GT(cv::countNonZero(lit), 5);
        };
        expect_extremes(0.5);
        sensor.read_noise_e = 1.0;
        expect_extremes(0.0);
    }
}

// Single precision is enough from 1e-4 of a step on.
TEST(SensorModel, GivesTheDocumentedCodeBesideEveryRoundingBoundary) {
    for (const double black : {0.0, 0.37 * 255.0}) {
        const Sensor sensor{.black_dn = black};
        CameraModel camera = camera_of_sensor(sensor, 510, 1);
        Radiance radiance(1, camera.width, CV_32FC1);
        for (int x = 0; x < camera.width; ++x) {
            const double boundary = x / 2 + 0.5 + (x % 2 == 0 ? -1.5e-4 : 1.5e-4);
            radiance.at<float>(0, x) = static_cast<float>((boundary - black) / (255.0 - black));
        }
        const SensorModel model(camera);
        on_every_target([&] {
            const CodeImage image = model.expose(radiance);
            for (int x = 0; x < camera.width; ++x)
                ASSERT_EQ(image.pixels.at<std::uint8_t>(0, x),
                          documented_code(sensor, radiance.at<float>(0, x)))
                    << radiance.at<float>(0, x) << " at pixel " << x;
        });
    }
}

TEST(SensorModel, GivesAPixelInAnEvenBackgroundItsOwnCode) {
    const SensorModel model(camera_of(200, 1));
    on_every_target([&] {
        for (int x = 0; x < 200; ++x) {
            Radiance radiance = uniform(0.8, 200, 1);
            radiance.at<float>(0, x) = 0.3f;
            cv::Mat expected(1, 200, CV_8UC1, cv::Scalar(204));  // 0.8 * 255
            expected.at<std::uint8_t>(0, x) = 77;  // 0.3f is 0.3 + 1.2e-8, and 0.3 * 255 = 76.5
            ASSERT_EQ(cv::norm(model.expose(radiance).pixels, expected, cv::NORM_INF), 0.0) << x;
        }
    });
}

// Alone, with a response and with noise; in the first of the stretches that are done at once, too.
TEST(SensorModel, FindsWhatIsNotFiniteAtEveryPlaceOfARow) {
    const Sensor filtered{.mosaic = Mosaic::rggb, .channel_response = {0.7, 1.0, 0.6}};
    Sensor noisy{.gain_e_per_dn = 30.0};
    for (const Sensor& sensor : {Sensor{}, filtered, noisy})
        for (const auto& [width, step] : {std::pair{37, 1}, std::pair{1400, 111}}) {
            const SensorModel model(camera_of_sensor(sensor, width, 2));
            on_every_target([&, width = width, step = step] {
                for (const float bad : {NAN, INFINITY, -INFINITY})
                    for (int x = 0; x < width; x += step) {
                        Radiance radiance = uniform(0.5, width, 2);
                        radiance.at<float>(1, x) = bad;
                        radiance.at<float>(1, width - 1) = bad;
                        EXPECT_THAT(
                            [&] {
                                model.expose(radiance, NoiseKey{1, 2});
                            },
                            testing::ThrowsMessage<NumericalError>(
                                HasSubstr(fmt::format("pixel ({}, 1)", x))));
                    }
            });
        }
}

// A response beyond a float's range is no code either.
TEST(SensorModel, RefusesAResponseThatIsNotFinite) {
    const Sensor sensor{.mosaic = Mosaic::rggb, .channel_response = {1.0, 1e39, 1.0}};
    const SensorModel model(camera_of_sensor(sensor, 600, 2));
    EXPECT_THROW(model.expose(uniform(0.5, 600, 2)), NumericalError);
}

// A table's row in the middle between two codes, just where a piece of the curve begins: 0.735... *
// 0.51 is 1.4e-8 below 0.375, whose nearest float it rounds to.
TEST(SensorModel, GivesARoundedProductBelowAStepTheCodeBelow) {
    const Transfer table{Transfer::Kind::table,
                         {{0.0, 0.0}, {0.375, 46.5 / 255.0}, {0.3757, 0.18612}, {1.0, 0.508}}};
    const Sensor sensor{
        .transfer = table, .mosaic = Mosaic::rggb, .channel_response = {0.51, 0.51, 0.51}};
    on_every_target([&] {
        const CodeImage image =
            SensorModel(camera_of_sensor(sensor, 64, 2)).expose(uniform(0.735294104f, 64, 2));
        EXPECT_EQ(image.pixels.at<std::uint8_t>(0, 0), 46);
    });
}

TEST(SensorModel, RefusesASectionThatContradictsItself) {
    const auto refused = [](auto change) {
        Sensor sensor;
        change(sensor);
        EXPECT_THROW(SensorModel{camera_of_sensor(sensor)}, ConfigError);
    };
    refused([](Sensor& s) { s.bits = 0; });
    refused([](Sensor& s) { s.bits = 17; });
    refused([](Sensor& s) { s.black_dn = 255.0; });
    refused([](Sensor& s) { s.black_dn = std::nan(""); });
    refused([](Sensor& s) { s.gain_e_per_dn = -1.0; });
    refused([](Sensor& s) { s.read_noise_e = 5.0; });
    refused([](Sensor& s) { s.transfer = {Transfer::Kind::table, {}}; });
    refused([](Sensor& s) { s.transfer = {Transfer::Kind::table, {{0, 0}, {0.7, 1}}}; });
    refused([](Sensor& s) { s.transfer = {Transfer::Kind::table, {{0, 0}, {0.7, 0}, {1, 1}}}; });
    refused([](Sensor& s) { s.transfer = {Transfer::Kind::table, {{0, 0}, {1, 1.2}}}; });
}

// Half the diagonal of an 8 x 6 px image is 5 px: r is the distance from (cx, cy) in units of it.
CameraModel shaded(const std::array<double, 3>& polynomial) {
    CameraModel camera = test::camera_with(8, 6, {10.0, 10.0, 3.0, 2.0}, {});
    camera.sensor = Sensor{.bits = 16};
    camera.sensor->illumination = {Illumination::Kind::polynomial, polynomial};
    return camera;
}

TEST(SensorModel, MultipliesAMeasuredIllumination) {
    const SensorModel model(shaded({-0.31, 0.12, -0.05}));
    for (const auto& [x, y] : {std::pair{3, 2}, {7, 5}, {0, 4}}) {
        const double s = ((x - 3.0) * (x - 3.0) + (y - 2.0) * (y - 2.0)) / 25.0;
        const double expected = 1.0 - 0.31 * s + 0.12 * s * s - 0.05 * s * s * s;
        EXPECT_NEAR(model.relative_response().at<float>(y, x), expected, 1e-7);
        const Radiance radiance(6, 8, CV_32FC1, cv::Scalar(0.8));
        EXPECT_EQ(model.expose(radiance).pixels.at<std::uint16_t>(y, x),
                  std::floor(65535 * double(0.8f) * static_cast<float>(expected) + 0.5));
    }
}

TEST(SensorModel, RefusesAnIlluminationThatVanishesInTheImage) {
    // Farthest is the corner (7.5, 5.5): s = 1.3. The least value of the whole square, by search.
    std::mt19937 random(3);
    std::uniform_real_distribution<double> coefficient(-4.0, 4.0);
    int refused = 0;
    for (int n = 0; n < 300; ++n) {
        const std::array<double, 3> c{coefficient(random), coefficient(random),
                                      coefficient(random)};
        double least = 1.0;
        for (int i = 0; i <= 20000; ++i)
            least = std::min(least, polynomial_illumination(c, 1.3 * i / 20000.0));
        const CameraModel camera = shaded(c);
        EXPECT_NEAR(least_polynomial_illumination(camera), least, 1e-6);
        refused += least <= 0.0;
        if (least <= 0.0) {
            EXPECT_THROW(SensorModel{camera}, ConfigError);
        }
    }
    EXPECT_GT(refused, 50);
    EXPECT_LT(refused, 250);
    EXPECT_THROW(SensorModel{shaded({std::nan(""), 0.0, 0.0})}, ConfigError);
    EXPECT_NO_THROW(SensorModel{shaded({0.0, 0.0, 0.0})});
}

TEST(SensorModel, KnowsTheColourOfEveryPixelOfAMosaic) {
    const auto word = [](Mosaic mosaic) {
        std::string letters;
        for (int y = 2; y < 4; ++y)
            for (int x = 4; x < 6; ++x)
                letters += "RGB"[static_cast<int>(channel_of_pixel(mosaic, x, y))];
        return letters;
    };
    EXPECT_EQ(word(Mosaic::rggb), "RGGB");
    EXPECT_EQ(word(Mosaic::bggr), "BGGR");
    EXPECT_EQ(word(Mosaic::grbg), "GRBG");
    EXPECT_EQ(word(Mosaic::gbrg), "GBRG");
}

TEST(SensorModel, GivesEachChannelItsSignalAndItsNoise) {
    CameraModel camera =
        camera_of_sensor(Sensor{.bits = 12, .black_dn = 64.0, .gain_e_per_dn = 2.0}, 200, 200);
    camera.sensor->mosaic = Mosaic::gbrg;
    camera.sensor->channel_response = {0.5, 1.0, 0.25};
    const SensorModel model(camera);
    const Radiance radiance(200, 200, CV_32FC1, cv::Scalar(0.6));
    const CodeImage clean = model.expose(radiance), noisy = model.expose(radiance, NoiseKey{5, 1});
    const double range = 4095.0 - 64.0;
    EXPECT_EQ(clean.pixels.at<std::uint16_t>(0, 0), std::round(64 + range * 0.6));         // green
    EXPECT_EQ(clean.pixels.at<std::uint16_t>(0, 1), std::round(64 + range * 0.6 * 0.25));  // blue
    EXPECT_EQ(clean.pixels.at<std::uint16_t>(1, 0), std::round(64 + range * 0.6 * 0.5));   // red
    EXPECT_EQ(clean.pixels.at<std::uint16_t>(3, 5), std::round(64 + range * 0.6));         // green
    // Photon noise: variance = signal / gain. 10 000 blue pixels: 1.4 % standard error.
    double squares = 0.0;
    for (int y = 0; y < 200; y += 2)
        for (int x = 1; x < 200; x += 2)
            squares +=
                std::pow(noisy.pixels.at<std::uint16_t>(y, x) - (64 + range * 0.6 * 0.25), 2);
    EXPECT_NEAR(squares / 1e4, range * 0.6 * 0.25 / 2.0 + 1.0 / 12.0, 0.06 * range * 0.6 * 0.125);
}

// Whatever the sensor does: of one code for the background, or of noise and illumination there too.
TEST(SensorModel, ExposesAPartAsTheWholeWouldBe) {
    RenderedPart part{{40, 30, 57, 21}, Radiance(21, 57, CV_32FC1), 0.37, {}};
    for (int y = 0; y < 21; ++y)
        for (int x = 0; x < 57; ++x)
            part.radiance.at<float>(y, x) = static_cast<float>(0.017 * x + 0.003 * y);
    CameraModel camera = camera_of(160, 90);
    Radiance whole = uniform(0.37, 160, 90);
    part.radiance.copyTo(whole(part.region));
    const NoiseKey key{3, 4};
    for (const int bits : {8, 12})
        for (const bool vignetted : {false, true})
            for (const auto curve : {Transfer::Kind::linear, Transfer::Kind::rec709}) {
                camera.sensor = Sensor{.bits = bits, .black_dn = 3.0, .gain_e_per_dn = 5.0};
                camera.sensor->transfer.kind = curve;
                if (vignetted)
                    camera.sensor->illumination = {Illumination::Kind::polynomial, {-0.2, 0, 0}};
                const SensorModel model(camera);
                for (const std::optional<NoiseKey> noise : {std::optional<NoiseKey>(), {key}}) {
                    const cv::Mat expected = model.expose(whole, noise).pixels;
                    EXPECT_EQ(cv::norm(model.expose(part, noise).pixels, expected, cv::NORM_INF),
                              0.0);
                    EXPECT_EQ(cv::norm(model.expose_region(part, noise).pixels,
                                       expected(part.region), cv::NORM_INF),
                              0.0);
                }
            }
    part.region.x = camera.width - 56;
    EXPECT_THROW(SensorModel{camera}.expose(part), NumericalError);
    part.region = {};
    part.radiance.release();
    part.background = std::nan("");
    EXPECT_THROW(SensorModel{camera}.expose(part), NumericalError);
}

TEST(SensorModel, RefusesAChannelWithoutResponse) {
    CameraModel camera = shaded({0.0, 0.0, 0.0});
    camera.sensor->mosaic = Mosaic::rggb;
    camera.sensor->channel_response = {1.0, 1.0, -0.1};
    EXPECT_THROW(SensorModel{camera}, ConfigError);
}

}  // namespace
}  // namespace etalon
