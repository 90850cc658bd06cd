#include "core/statistics/random.h"

#include "tests/test.h"

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

// The words around `centre`, and then some that are nowhere special.
std::vector<std::uint32_t> words_around(const std::vector<std::uint32_t>& centres) {
    std::vector<std::uint32_t> words;
    for (const std::uint32_t centre : centres)
        for (std::uint32_t n = 0; n < 7; ++n)
            words.push_back(centre + n - 3);
    RandomStream random(5, 1);
    for (int n = 0; n < 2000; ++n)
        words.push_back(random.bits());
    return words;
}

long double uniform(std::uint32_t word) {
    return (word + 0.5L) * 0x1p-32L;
}

// Twice the limit of core/statistics/random.h: where a long double is a double, the expected
// values have such errors too.
constexpr double tolerance = 3e-15;

// Word 0 makes the longest, 6.66; 0xffffffff the shortest, 1.5e-5. Beside them where the logarithm
// changes its octave: u = 2^-k sqrt(1/2), and where it is that of a power of two.
TEST(BoxMuller, HasTheRadiusOfTheLogarithmAtEveryMagnitude) {
    std::vector<std::uint32_t> centres{0};
    for (int k = 0; k < 32; ++k) {
        centres.push_back(static_cast<std::uint32_t>(std::ldexp(std::sqrt(0.5), 32 - k)));
        centres.push_back(std::uint32_t{1} << k);
    }
    for (const std::uint32_t word : words_around(centres)) {
        const NormalPair pair = box_muller(word, 0x12345678);
        const long double radius = std::sqrt(-2.0L * std::log1p(uniform(word) - 1.0L));
        EXPECT_NEAR(std::hypot(pair.cosine, pair.sine) / double(radius), 1.0, tolerance) << word;
    }
    EXPECT_NEAR(box_muller(0, 0).cosine, std::sqrt(66.0 * std::numbers::ln2), 1e-14);
    EXPECT_NEAR(box_muller(~0u, 0).cosine, 0x1p-16, 1e-14);
}

// Quarters begin at multiples of 2^30, eighths at those of 2^29.
TEST(BoxMuller, HasTheDirectionOfTheAngleInEveryQuadrant) {
    std::vector<std::uint32_t> centres;
    for (std::uint32_t eighth = 0; eighth < 8; ++eighth)
        centres.push_back(eighth << 29);
    const std::uint32_t word = 0x9abcdef0;
    const auto radius = static_cast<double>(std::sqrt(-2.0L * std::log(uniform(word))));
    for (const std::uint32_t angle_word : words_around(centres)) {
        const NormalPair pair = box_muller(word, angle_word);
        const long double angle = 2.0L * std::numbers::pi_v<long double> * uniform(angle_word);
        EXPECT_NEAR(pair.cosine / radius, double(std::cos(angle)), tolerance) << angle_word;
        EXPECT_NEAR(pair.sine / radius, double(std::sin(angle)), tolerance) << angle_word;
    }
}

// The arguments are reduced without a rounding: beside a zero of the cosine, where that of the
// rounded 2 pi v would be off by 1e-6 of its value, it is as right as everywhere.
TEST(BoxMuller, KeepsItsRelativeErrorBesideItsZeros) {
    const double radius = box_muller(77, 0).cosine;
    const double step = 2.0 * std::numbers::pi * 0x1p-33;  // half a word
    EXPECT_NEAR(box_muller(77, 0x40000000).cosine / radius / -step, 1.0, tolerance);
    EXPECT_NEAR(box_muller(77, 0x3fffffff).cosine / radius / step, 1.0, tolerance);
    EXPECT_NEAR(box_muller(77, 0xc0000001).cosine / radius / (3.0 * step), 1.0, tolerance);
    EXPECT_NEAR(box_muller(77, 0x80000000).sine / radius / -step, 1.0, tolerance);
    EXPECT_NEAR(box_muller(77, 0).sine / radius / step, 1.0, tolerance);
}

// Both of the pair, in their order: the first two words of a block make two numbers.
TEST(RandomStream, DrawsItsNormalNumbersInPairs) {
    RandomStream words(3, 9, 27), numbers(3, 9, 27);
    for (int n = 0; n < 5; ++n) {
        const std::uint32_t radius_word = words.bits();
        const NormalPair pair = box_muller(radius_word, words.bits());
        EXPECT_EQ(numbers.normal(), pair.cosine);
        EXPECT_EQ(numbers.normal(), pair.sine);
    }
}

}  // namespace
}  // namespace etalon
