#include "sim/scene/pose_sampling.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>

#include "core/program/errors.h"

namespace etalon {
namespace {

using testing::DoubleEq;
using testing::Pointwise;

// Van der Corput's sequence in base 2 and its like in base 3, from the digits by hand.
TEST(HaltonSequence, MirrorsTheDigitsAtThePoint) {
    const std::vector<double> base2{0, 1 / 2., 1 / 4., 3 / 4., 1 / 8., 5 / 8., 3 / 8., 7 / 8.};
    const std::vector<double> base3{0,      1 / 3., 2 / 3., 1 / 9., 4 / 9.,
                                    7 / 9., 2 / 9., 5 / 9., 8 / 9., 1 / 27.};
    const HaltonSequence halton(2, {});
    for (std::size_t i = 0; i < base2.size(); ++i)
        EXPECT_DOUBLE_EQ(halton.point(i)[0], base2[i]);
    for (std::size_t i = 0; i < base3.size(); ++i)
        EXPECT_DOUBLE_EQ(halton.point(i)[1], base3[i]);
    EXPECT_LT(halton.point(~std::uint64_t{0})[0], 1.0);
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

// H. Faure 1992, table of the permutations for the first bases.
TEST(FaurePermutation, IsThePublishedOne) {
    using Digits = std::vector<int>;
    EXPECT_EQ(faure_permutation(2), (Digits{0, 1}));
    EXPECT_EQ(faure_permutation(3), (Digits{0, 1, 2}));
    EXPECT_EQ(faure_permutation(4), (Digits{0, 2, 1, 3}));
    EXPECT_EQ(faure_permutation(5), (Digits{0, 3, 2, 1, 4}));
    EXPECT_EQ(faure_permutation(6), (Digits{0, 2, 4, 1, 3, 5}));
    EXPECT_EQ(faure_permutation(7), (Digits{0, 2, 5, 3, 1, 4, 6}));
    EXPECT_EQ(faure_permutation(8), (Digits{0, 4, 2, 6, 1, 5, 3, 7}));
}

// By induction from the definition: s(b - 1 - i) = b - 1 - s(i).
TEST(FaurePermutation, HoldsEveryDigitOnceAndIsSymmetric) {
    for (int base = 2; base <= 71; ++base) {
        const std::vector<int> permutation = faure_permutation(base);
        ASSERT_EQ(permutation.size(), static_cast<std::size_t>(base));
        for (std::size_t i = 0; i < permutation.size(); ++i)
            EXPECT_EQ(permutation[i] + permutation[permutation.size() - 1 - i], base - 1);
        EXPECT_EQ(std::set<int>(permutation.begin(), permutation.end()).size(), permutation.size());
    }
}

TEST(HaltonSequence, PermutesEveryDigitAsFaureDoes) {
    const auto halton = HaltonSequence::with_faure_permutations(4, {});
    // 19 = 10011b = 201 in base 3 = 34 in base 5 = 25 in base 7.
    EXPECT_THAT(halton.point(19), Pointwise(DoubleEq(), {25 / 32., 1 / 3. + 2 / 27.,
                                                         4 / 5. + 1 / 25., 4 / 7. + 5 / 49.}));
}

// The remainder theorem: 8 * 9 * 5 points that follow each other, wherever they begin, visit every
// combination of the last 3, 2 and 1 digits once, and a random start only adds to each.
TEST(HaltonSequence, StaysStratifiedInAllDimensionsTogetherFromARandomStart) {
    for (const std::uint64_t seed : {1u, 57u}) {
        const auto halton = HaltonSequence::with_faure_permutations(3, seed);
        for (const std::uint64_t first : {0u, 17u, 100003u}) {
            std::set<std::vector<int>> hit;
            for (std::uint64_t i = 0; i < 360; ++i) {
                const auto p = halton.point(first + i);
                const auto part = [](double x, int parts) {
                    return static_cast<int>(std::floor(x * parts + 1e-9));
                };
                hit.insert({part(p[0], 8), part(p[1], 9), part(p[2], 5)});
            }
            EXPECT_EQ(hit.size(), 360u) << "from " << first;
        }
    }
}

// In base 2, which Faure leaves as it is, the point's mirrored digits count the index from a start.
TEST(HaltonSequence, CountsOnFromItsRandomStart) {
    const auto halton = HaltonSequence::with_faure_permutations(1, 23);
    const auto counted = [&](std::uint64_t index) {
        double x = halton.point(index)[0];
        int count = 0;
        for (int digit = 0; digit < 12; ++digit) {
            count |= static_cast<int>(2.0 * x) << digit;
            x = 2.0 * x - std::floor(2.0 * x);
        }
        return count;
    };
    const int start = counted(0);
    EXPECT_NE(start, 0);
    for (const int index : {1, 2, 7, 100, 4095, 4096, 5000})
        EXPECT_EQ(counted(static_cast<std::uint64_t>(index)), (start + index) % 4096);
}

class AnySequence : public testing::TestWithParam<SequenceKind> {};

// The product of 1 + (x - 1/2) over six dimensions has the mean 1 and the variance
// (1 + 1/12)^6 - 1: over 1024 random points an error of 0.0245 r.m.s. Without bias, the mean of 25
// seeds is as far from 1 as chance makes it (four standard deviations of it).
TEST_P(AnySequence, IntegratesBetterThanRandomPointsAndWithoutBias) {
    constexpr int points = 1024, seeds = 25;
    double sum = 0.0, square = 0.0;
    for (std::uint64_t seed = 0; seed < seeds; ++seed) {
        const PointSequence sequence(GetParam(), 6, seed);
        double mean = 0.0;
        for (std::uint64_t i = 0; i < points; ++i) {
            const auto p = sequence.point(i);
            mean += std::accumulate(p.begin(), p.end(), 1.0 / points,
                                    [](double a, double x) { return a * (0.5 + x); });
        }
        sum += mean - 1.0;
        square += (mean - 1.0) * (mean - 1.0);
    }
    const double error = std::sqrt(square / seeds);
    EXPECT_LT(error, 0.0245 / 4.0);
    EXPECT_LT(std::abs(sum / seeds), 4.0 * error / std::sqrt(seeds));
}

// One coordinate of one point over 1000 seeds: the largest distance of its distribution from the
// uniform one (Kolmogorov and Smirnov) is below 1.95 / sqrt(1000) in 999 of 1000 cases.
TEST_P(AnySequence, MakesEveryPointUniformOverTheSeeds) {
    for (const std::size_t dimension : {0u, 4u, 15u}) {
        std::vector<double> x;
        for (std::uint64_t seed = 0; seed < 1000; ++seed)
            x.push_back(PointSequence(GetParam(), 16, 7919 * seed).point(3)[dimension]);
        std::sort(x.begin(), x.end());
        double distance = 0.0;
        for (std::size_t i = 0; i < x.size(); ++i)
            distance = std::max({distance, x[i] - static_cast<double>(i) / 1000.0,
                                 static_cast<double>(i + 1) / 1000.0 - x[i]});
        EXPECT_LT(distance, 1.95 / std::sqrt(1000.0)) << "dimension " << dimension;
    }
}

TEST_P(AnySequence, IsAnotherOneForAnotherSeedAndKeepsItsDimensionsWhenSomeAreAdded) {
    const SequenceKind kind = GetParam();
    const auto point = PointSequence(kind, 3, 5).point(11);
    EXPECT_EQ(PointSequence(kind, 3, 5).point(11), point);
    const auto other = PointSequence(kind, 3, 7).point(11);
    const auto wide = PointSequence(kind, 16, 5).point(11);
    ASSERT_EQ(wide.size(), 16u);
    for (std::size_t d = 0; d < 3; ++d) {
        EXPECT_NE(other[d], point[d]);
        EXPECT_EQ(wide[d], point[d]);
    }
    EXPECT_THROW(PointSequence(kind, 0, 5), NumericalError);
    EXPECT_THROW(PointSequence(kind, 17, 5), NumericalError);
}

INSTANTIATE_TEST_SUITE_P(AllKinds, AnySequence,
                         testing::Values(SequenceKind::halton, SequenceKind::halton_faure,
                                         SequenceKind::sobol));

}  // namespace
}  // namespace etalon
