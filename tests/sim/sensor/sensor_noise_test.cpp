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

// n = 1e6 standard deviates: the standard errors of the mean powers 1 to 4 are sqrt(1 / n),
// sqrt(2 / n), sqrt(15 / n) and sqrt(96 / n); 4 of each (two-sided 6e-5 per check). The largest is
// beyond 4.5 and below 5.7 but for 1 of 1000 and 1 of 80 sets.
TEST(SensorNoise, HasTheMomentsOfTheNormalDistribution) {
    const int n = 1'000'000;
    std::vector<double> deviates(n, 0.0);
    add_noise({0.0, 1.0}, {11, 2}, 0, n, deviates.data());
    double sums[5] = {};
    double largest = 0.0;
    for (const double x : deviates) {
        for (int power = 1; power <= 4; ++power)
            sums[power] += std::pow(x, power) / n;
        largest = std::max(largest, std::abs(x));
    }
    EXPECT_NEAR(sums[1], 0.0, 4 * std::sqrt(1.0 / n));
    EXPECT_NEAR(sums[2], 1.0, 4 * std::sqrt(2.0 / n));
    EXPECT_NEAR(sums[3], 0.0, 4 * std::sqrt(15.0 / n));
    EXPECT_NEAR(sums[4], 3.0, 4 * std::sqrt(96.0 / n));
    EXPECT_GT(largest, 4.5);
    EXPECT_LT(largest, 5.7);
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
