#include "sim/scene/pose_sampling.h"

#include <gmock/gmock.h>

#include <cmath>
#include <set>

#include "core/program/errors.h"

namespace etalon {
namespace {

using testing::ElementsAre;

// The first binary digit of a dimension's direction number i: point 2^i is that number.
int first_digit(const SobolSequence& sobol, std::size_t dimension, int i) {
    return sobol.point(std::uint64_t{1} << i)[dimension] >= 0.5 ? 1 : 0;
}

std::uint64_t digits53(double coordinate) {
    return static_cast<std::uint64_t>(std::ldexp(coordinate, 53));
}

// Of the program that comes with the direction numbers, in the order of the Gray code.
TEST(SobolSequence, BeginsWithThePublishedPoints) {
    const std::vector<std::vector<double>> published{
        {0, 0, 0},
        {0.5, 0.5, 0.5},
        {0.75, 0.25, 0.25},
        {0.25, 0.75, 0.75},
        {0.375, 0.375, 0.625},
        {0.875, 0.875, 0.125},
        {0.625, 0.125, 0.875},
        {0.125, 0.625, 0.375},
        {0.1875, 0.3125, 0.9375},
        {0.6875, 0.8125, 0.4375},
    };
    const SobolSequence sobol(3, {});
    for (std::uint64_t i = 0; i < published.size(); ++i)
        EXPECT_EQ(sobol.point(i ^ (i >> 1)), published[i]) << i;
}

// First digits of the direction numbers follow the recurrence of the dimension's polynomial alone:
// b_i = a_1 b_(i-1) + ... + a_(s-1) b_(i-s+1) + b_(i-s) modulo 2.
bool follows(const std::vector<int>& b, int degree, int coefficients) {
    for (std::size_t i = static_cast<std::size_t>(degree); i < b.size(); ++i) {
        int sum = b[i - static_cast<std::size_t>(degree)];
        for (int k = 1; k < degree; ++k)
            sum += ((coefficients >> (degree - 1 - k)) & 1) * b[i - static_cast<std::size_t>(k)];
        if (sum % 2 != b[i])
            return false;
    }
    return true;
}

// A primitive polynomial of degree s runs through all 2^s - 1 states but 0; any other repeats one
// before (at degree 6 after at most 31 of the 59 states seen here).
bool is_primitive(const std::vector<int>& b, int degree) {
    const std::size_t period = (std::size_t{1} << degree) - 1;
    const std::size_t length = static_cast<std::size_t>(degree);
    std::set<std::vector<int>> states;
    std::size_t seen = 0;
    for (; seen < std::min(period, b.size() - length + 1); ++seen) {
        const auto first = b.begin() + static_cast<std::ptrdiff_t>(seen);
        states.insert({first, first + degree});
    }
    return states.size() == seen && states.count(std::vector<int>(length, 0)) == 0;
}

// All there are of degrees 1 to 5 and the first three of degree 6, ordered as in the publication.
TEST(SobolSequence, HasThePrimitivePolynomialsInTheirOrder) {
    const SobolSequence sobol(16, {});
    const std::vector<std::pair<int, int>> published{{1, 0},  {2, 1},  {3, 1}, {3, 2},  {4, 1},
                                                     {4, 4},  {5, 2},  {5, 4}, {5, 7},  {5, 11},
                                                     {5, 13}, {5, 14}, {6, 1}, {6, 13}, {6, 16}};
    for (std::size_t d = 1; d < 16; ++d) {
        std::vector<int> b;
        for (int i = 0; i < 64; ++i)
            b.push_back(first_digit(sobol, d, i));
        const auto [degree, coefficients] = published[d - 1];
        EXPECT_TRUE(is_primitive(b, degree)) << "dimension " << d;
        for (int other = 0; other < (1 << (degree - 1)); ++other)
            EXPECT_EQ(follows(b, degree, other), other == coefficients) << "dimension " << d;
    }
}

// Sobol's property A, which the publication states up to dimension 1111: of the first 2^d points
// one lies in each of the 2^d parts into which the halves of d axes cut the cube. That is, the
// first digits of the first d direction numbers are a regular matrix modulo 2.
TEST(SobolSequence, PutsOnePointIntoEachOrthant) {
    const SobolSequence sobol(16, {});
    for (int size = 1; size <= 16; ++size) {
        std::vector<std::uint32_t> rows;
        for (int d = 0; d < size; ++d) {
            std::uint32_t row = 0;
            for (int i = 0; i < size; ++i)
                row |=
                    static_cast<std::uint32_t>(first_digit(sobol, static_cast<std::size_t>(d), i))
                    << i;
            rows.push_back(row);
        }
        int rank = 0;
        for (int i = 0; i < size; ++i) {
            const auto pivot = std::find_if(rows.begin() + rank, rows.end(),
                                            [&](std::uint32_t row) { return (row >> i) & 1u; });
            if (pivot == rows.end())
                continue;
            std::iter_swap(rows.begin() + rank, pivot);
            const std::uint32_t taken = rows[static_cast<std::size_t>(rank++)];
            for (auto row = rows.begin() + rank; row != rows.end(); ++row)
                if ((*row >> i) & 1u)
                    *row ^= taken;
        }
        EXPECT_EQ(rank, size);
    }
}

class SobolNets : public testing::TestWithParam<std::optional<std::uint64_t>> {};

TEST_P(SobolNets, PutOnePointIntoEachIntervalOfEveryDimension) {
    const SobolSequence sobol(16, GetParam());
    for (const std::uint64_t block : {0u, 1u, 13u})
        for (std::size_t d = 0; d < 16; ++d) {
            std::set<int> hit;
            for (std::uint64_t i = 0; i < 256; ++i) {
                const double x = sobol.point(256 * block + i)[d];
                ASSERT_GE(x, 0.0);
                ASSERT_LT(x, 1.0);
                hit.insert(static_cast<int>(256.0 * x));
            }
            EXPECT_EQ(hit.size(), 256u) << "dimension " << d;
        }
}

TEST_P(SobolNets, PutOnePointIntoEachRectangleOfTheFirstTwoDimensions) {
    const SobolSequence sobol(2, GetParam());
    for (const std::uint64_t block : {0u, 3u})
        for (int columns = 1; columns <= 256; columns *= 2) {
            std::set<std::pair<int, int>> hit;
            for (std::uint64_t i = 0; i < 256; ++i) {
                const auto p = sobol.point(256 * block + i);
                hit.insert(
                    {static_cast<int>(columns * p[0]), static_cast<int>(256 / columns * p[1])});
            }
            EXPECT_EQ(hit.size(), 256u) << columns << " columns";
        }
}

INSTANTIATE_TEST_SUITE_P(PlainAndScrambled, SobolNets,
                         testing::Values(std::nullopt, std::uint64_t{1}, std::uint64_t{57}));

// What scrambling must keep: how many leading digits two points share. The digits of indices below
// 2^12 end after 12 + 1; equal points do not occur.
TEST(SobolSequence, ScramblesNestedly) {
    const SobolSequence plain(5, {}), scrambled(5, 23);
    for (std::uint64_t i = 0; i < 60; ++i)
        for (std::uint64_t j = 0; j < i; ++j) {
            const auto a = plain.point(67 * i), b = plain.point(67 * j);
            const auto c = scrambled.point(67 * i), d = scrambled.point(67 * j);
            for (std::size_t k = 0; k < 5; ++k)
                EXPECT_EQ(std::ilogb(static_cast<double>(digits53(a[k]) ^ digits53(b[k]))),
                          std::ilogb(static_cast<double>(digits53(c[k]) ^ digits53(d[k]))));
        }
}

// Whether a digit was flipped, for nodes of the tree that all differ: the same digit after other
// leading ones, digits on both sides of every seventh, the last, and both dimensions.
std::vector<int> flips(std::uint64_t seed) {
    const SobolSequence plain(2, {}), scrambled(2, seed);
    std::vector<int> result;
    const std::vector<std::pair<int, std::uint64_t>> nodes{{0, 1}, {1, 2},  {2, 4},  {6, 4}, {7, 4},
                                                           {8, 4}, {13, 2}, {14, 2}, {52, 3}};
    for (const auto& [digit, points] : nodes)
        for (std::uint64_t i = 0; i < points; ++i)
            for (std::size_t d = 0; d < 2; ++d)
                result.push_back(static_cast<int>(
                    ((digits53(plain.point(i)[d]) ^ digits53(scrambled.point(i)[d])) >>
                     (52 - digit)) &
                    1u));
    return result;
}

// Each is flipped in half of the seeds, and any two are alike in half of them: of 2000, with a
// standard deviation of sqrt(2000) / 2 = 22. Five of them for 1378 pairs: wrong by chance in 1 of
// 1000 sets of seeds, and this one is fixed.
TEST(SobolSequence, FlipsEveryDigitByARandomBitOfItsOwn) {
    constexpr int seeds = 2000;
    std::vector<std::vector<int>> all;
    for (std::uint64_t seed = 0; seed < seeds; ++seed)
        all.push_back(flips(seed));
    const std::size_t count = all.front().size();
    ASSERT_EQ(count, 52u);
    for (std::size_t a = 0; a < count; ++a)
        for (std::size_t b = 0; b <= a; ++b) {
            int hits = 0;
            for (const auto& flipped : all)
                hits += a == b ? flipped[a] : flipped[a] ^ flipped[b];
            EXPECT_NEAR(hits, seeds / 2, 5 * 22.4) << a << " and " << b;
        }
}

TEST(SobolSequence, TakesAnyIndexAndRefusesOtherDimensions) {
    EXPECT_THAT(SobolSequence(1, {}).point(std::uint64_t{1} << 52), ElementsAre(0x1p-53));
    const auto last = SobolSequence(16, 5).point(~std::uint64_t{0});
    EXPECT_THAT(last, testing::Each(testing::AllOf(testing::Ge(0.0), testing::Lt(1.0))));
    EXPECT_THROW(SobolSequence(0, 1), NumericalError);
    EXPECT_THROW(SobolSequence(17, 1), NumericalError);
}

}  // namespace
}  // namespace etalon
