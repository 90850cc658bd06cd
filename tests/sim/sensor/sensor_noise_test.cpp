#include "sim/sensor/sensor_simd.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/statistics/random.h"
#include "tests/sim/every_target.h"

namespace etalon {
namespace {

// The formula of sim/sensor/sensor_simd.h, one pixel at a time.
double documented(const SensorNoise& noise, const NoiseKey& key, std::uint64_t pixel,
                  double signal) {
    const double variance = std::max(signal, 0.0) * noise.shot_variance + noise.read_variance;
    return signal + std::sqrt(variance) * RandomStream(key.seed, key.frame, pixel).normal();
}

// From none to more than two stretches of any vector, at places of every alignment of a double; the
// neighbours stay. Pixel numbers pass 2^32, the key has bits in both halves.
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
                signal = documented(noise, key, pixel + static_cast<std::uint64_t>(x), signal);
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
    for (const std::size_t lag : {1u, 2u, 4u, 8u, 64u, 640u}) {
        double product = 0.0;
        for (std::size_t x = lag; x < n; ++x)
            product += first[x] * first[x - lag] / n;
        EXPECT_NEAR(product, 0.0, 4.5 / std::sqrt(double(n))) << lag;
    }
    double product = 0.0;
    for (std::size_t x = 0; x < n; ++x)
        product += first[x] * next[x] / n;
    EXPECT_NEAR(product, 0.0, 4.5 / std::sqrt(double(n)));
}

}  // namespace
}  // namespace etalon
