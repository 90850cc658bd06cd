#include "sim/pose_sampling.h"

#include <gmock/gmock.h>

#include <cmath>
#include <set>

#include "core/errors.h"

namespace etalon {
namespace {

using testing::DoubleEq;
using testing::Pointwise;

// Van der Corput's sequence in base 2 and its like in base 3, from the digits by hand.
TEST(RadicalInverse, MirrorsTheDigitsAtThePoint) {
    const std::vector<double> base2{0, 1 / 2., 1 / 4., 3 / 4., 1 / 8., 5 / 8., 3 / 8., 7 / 8.};
    const std::vector<double> base3{0,      1 / 3., 2 / 3., 1 / 9., 4 / 9.,
                                    7 / 9., 2 / 9., 5 / 9., 8 / 9., 1 / 27.};
    for (std::size_t i = 0; i < base2.size(); ++i)
        EXPECT_DOUBLE_EQ(radical_inverse(i, 2), base2[i]);
    for (std::size_t i = 0; i < base3.size(); ++i)
        EXPECT_DOUBLE_EQ(radical_inverse(i, 3), base3[i]);
    EXPECT_LT(radical_inverse(~std::uint64_t{0}, 2), 1.0);
}

TEST(HaltonSequence, WithoutASeedTakesThePrimesInTurn) {
    const HaltonSequence halton(4, {});
    EXPECT_THAT(halton.point(7), Pointwise(DoubleEq(), {7 / 8., 5 / 9., 11 / 25., 1 / 49.}));
}

class Stratification : public testing::TestWithParam<std::optional<std::uint64_t>> {};

TEST_P(Stratification, PutsOnePointIntoEachIntervalOfEachBase) {
    const std::vector<int> bases{2, 3, 5, 7, 11, 13};
    const HaltonSequence halton(6, GetParam());
    for (std::size_t d = 0; d < bases.size(); ++d) {
        const int intervals = bases[d] * bases[d];
        for (const int block : {0, 1, 7}) {
            std::set<int> hit;
            for (int i = 0; i < intervals; ++i) {
                const double x = halton.point(static_cast<std::uint64_t>(block * intervals + i))[d];
                ASSERT_GE(x, 0.0);
                ASSERT_LT(x, 1.0);
                // A thousandth of an interval against rounding at its lower end; random points
                // come that near to an upper end in 1 of 1000 cases, none of them here.
                hit.insert(static_cast<int>(std::floor(x * intervals + 1e-9)));
            }
            EXPECT_EQ(hit.size(), static_cast<std::size_t>(intervals)) << "base " << bases[d];
        }
    }
}

INSTANTIATE_TEST_SUITE_P(PlainAndPermuted, Stratification,
                         testing::Values(std::nullopt, std::uint64_t{1}, std::uint64_t{57}));

TEST(HaltonSequence, IsAnotherOneForAnotherSeedAndTheSameForTheSame) {
    EXPECT_EQ(HaltonSequence(3, 5).point(11), HaltonSequence(3, 5).point(11));
    EXPECT_NE(HaltonSequence(3, 5).point(11), HaltonSequence(3, 7).point(11));
    // The first coordinates do not change when dimensions are added.
    EXPECT_EQ(HaltonSequence(3, 5).point(11)[1], HaltonSequence(7, 5).point(11)[1]);
}

// Neighbouring high bases (17 and 19) make the first plain points a line: correlation 1. The
// permuted ones must not be. 15 points of independent coordinates have a correlation of standard
// deviation 1 / sqrt(14) = 0.27; the mean of 20 seeds 0.06: 5 sigma is 0.3.
TEST(HaltonSequence, LosesItsLinesByTheSeed) {
    const auto correlation = [](const HaltonSequence& halton) {
        double sx = 0, sy = 0, sxx = 0, syy = 0, sxy = 0;
        const int n = 15;
        for (int i = 1; i <= n; ++i) {
            const auto p = halton.point(static_cast<std::uint64_t>(i));
            const double x = p[6], y = p[7];
            sx += x, sy += y, sxx += x * x, syy += y * y, sxy += x * y;
        }
        return (n * sxy - sx * sy) / std::sqrt((n * sxx - sx * sx) * (n * syy - sy * sy));
    };
    EXPECT_GT(correlation(HaltonSequence(8, {})), 0.999);
    double mean = 0.0;
    for (std::uint64_t seed = 0; seed < 20; ++seed)
        mean += correlation(HaltonSequence(8, seed)) / 20.0;
    EXPECT_LT(std::abs(mean), 0.3);
}

TEST(HaltonSequence, RefusesMoreDimensionsThanItHasBases) {
    EXPECT_THROW(HaltonSequence(0, {}), NumericalError);
    EXPECT_THROW(HaltonSequence(21, {}), NumericalError);
    EXPECT_EQ(HaltonSequence(20, 3).point(5).size(), 20u);
}

}  // namespace
}  // namespace etalon
