#include "core/statistics/random.h"

#include <gtest/gtest.h>

#include <cmath>

namespace etalon {
namespace {

// Known answers from the authors' published test vectors of Philox4x32-10 (Random123, kat_vectors).
TEST(Philox, GivesThePublishedKnownAnswers) {
    EXPECT_EQ(philox(0, {0, 0, 0, 0}),
              (std::array<std::uint32_t, 4>{0x6627e8d5u, 0xe169c58du, 0xbc57ac4cu, 0x9b00dbd8u}));
    EXPECT_EQ(philox(~std::uint64_t{0}, {~0u, ~0u, ~0u, ~0u}),
              (std::array<std::uint32_t, 4>{0x408f276du, 0x41c83b0eu, 0xa20bc7c6u, 0x6d5451fdu}));
}

TEST(RandomStream, DependsOnEveryPartOfItsKey) {
    const std::uint32_t first = RandomStream(7, 5, 3).bits();
    EXPECT_EQ(first, RandomStream(7, 5, 3).bits());
    EXPECT_NE(first, RandomStream(8, 5, 3).bits());
    EXPECT_NE(first, RandomStream(7, 6, 3).bits());
    EXPECT_NE(first, RandomStream(7, 5, 4).bits());
    EXPECT_NE(first, RandomStream(7, 5, 3 + (std::uint64_t{1} << 32)).bits());
}

// n = 200 000: the standard errors are 1/sqrt(n) of the mean, sqrt(2/n) of the variance and
// sqrt(24/n) of the excess kurtosis; 4 of each (two-sided 6e-5 per check).
TEST(RandomStream, NormalHasTheMomentsOfTheNormalDistribution) {
    RandomStream random(11, 2);
    const int n = 200'000;
    double sum = 0, squares = 0, fourth = 0;
    for (int i = 0; i < n; ++i) {
        const double x = random.normal();
        sum += x;
        squares += x * x;
        fourth += x * x * x * x;
    }
    EXPECT_NEAR(sum / n, 0.0, 4 * std::sqrt(1.0 / n));
    EXPECT_NEAR(squares / n, 1.0, 4 * std::sqrt(2.0 / n));
    EXPECT_NEAR(fourth / n, 3.0, 4 * std::sqrt(96.0 / n));
}

TEST(RandomStream, UniformStaysInsideTheOpenInterval) {
    RandomStream random(13, 2);
    for (int i = 0; i < 100'000; ++i) {
        const double u = random.uniform();
        ASSERT_GT(u, 0.0);
        ASSERT_LT(u, 1.0);
    }
}

}  // namespace
}  // namespace etalon
