#include "core/statistics/distributions.h"

#include <Eigen/Dense>

#include "core/statistics/covariance.h"
#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

// Both have closed forms of their own.
TEST(StudentT, HasTheClosedFormsOfOneAndTwoDegreesOfFreedom) {
    for (const double tail : {0.5, 0.3, 0.025, 1e-4, 1e-8}) {
        const double one = std::tan(std::numbers::pi * (0.5 - tail));
        const double a = 1.0 - 2.0 * tail;
        const double two = a * std::sqrt(2.0 / (1.0 - a * a));
        EXPECT_NEAR(student_t_quantile(tail, 1), one, 1e-7 * (1.0 + one)) << tail;
        EXPECT_NEAR(student_t_quantile(tail, 2), two, 1e-7 * (1.0 + two)) << tail;
    }
}

// The density, integrated by Simpson's rule in 20 000 steps.
double integrated(double t, int n) {
    const auto density = [n](double x) {
        return std::exp(std::lgamma(0.5 * (n + 1)) - std::lgamma(0.5 * n)) /
               std::sqrt(n * std::numbers::pi) * std::pow(1.0 + x * x / n, -0.5 * (n + 1));
    };
    constexpr int steps = 20'000;
    double sum = density(0.0) + density(t);
    for (int i = 1; i < steps; ++i)
        sum += (i % 2 == 1 ? 4.0 : 2.0) * density(t * i / steps);
    return 0.5 + sum * t / steps / 3.0;
}

TEST(StudentT, AgreesWithTheIntegralOfItsDensity) {
    for (const int n : {1, 3, 4, 7, 18, 75})
        for (const double t : {0.4, 1.7, 5.3}) {
            EXPECT_NEAR(student_t_probability(t, n), integrated(t, n), 1e-10) << n << " " << t;
            EXPECT_NEAR(student_t_probability(-t, n), 1.0 - integrated(t, n), 1e-10);
        }
}

TEST(StudentT, QuantilesUndoProbabilities) {
    for (const int n : {1, 5, 18, 110})
        for (const double tail : {0.4, 0.05, 1e-3, 1e-7})
            EXPECT_NEAR(1.0 - student_t_probability(student_t_quantile(tail, n), n), tail,
                        1e-9 * tail + 1e-14);
}

TEST(StudentT, RefusesWhatHasNoQuantile) {
    EXPECT_THROW(student_t_quantile(0.0, 5), NumericalError);
    EXPECT_THROW(student_t_quantile(0.7, 5), NumericalError);
    EXPECT_THROW(student_t_quantile(std::nan(""), 5), NumericalError);
    EXPECT_THROW(student_t_quantile(0.1, 0), NumericalError);
}

TEST(Normal, QuantilesUndoProbabilities) {
    for (const double z : {-1.3, 0.2, 2.7, 7.35})
        EXPECT_NEAR(normal_quantile(normal_probability(-z)), z, 1e-12);
}

// With two degrees of freedom chi-square is exponential, with one a square of a normal value.
TEST(ChiSquare, HasTheClosedFormsOfOneAndTwoDegreesOfFreedom) {
    for (const double z : {-3.1, 0.0, 1.7, 4.75}) {
        EXPECT_NEAR(reduced_chi_square(z, 2.0), -std::log(normal_probability(-z)), 1e-12);
        const double one = normal_quantile(0.5 * normal_probability(-z));
        EXPECT_NEAR(reduced_chi_square(z, 1.0), one * one, 1e-11);
    }
}

// F with two degrees above is (1 + 2 f / n)^(-n / 2); with one it is the square of Student's t.
TEST(Fisher, HasTheClosedFormOfTwoDegreesAboveAndIsStudentsSquareWithOne) {
    EXPECT_NEAR(fisher_tail(3.7, 2.0, 9.0), std::pow(1.0 + 2.0 * 3.7 / 9.0, -4.5), 1e-14);
    EXPECT_NEAR(fisher_tail(2.3 * 2.3, 1.0, 7.0), 2.0 * student_t_probability(-2.3, 7), 1e-14);
    EXPECT_EQ(fisher_tail(0.0, 3.0, 5.0), 1.0);
}

// Of ten tosses 1 and 11 of 1024 ways have no head and at most one.
TEST(Coin, QuantileIsTheLargestCountWithinTheTail) {
    EXPECT_EQ(coin_quantile(0.5 / 1024.0, 10), 0u);
    EXPECT_EQ(coin_quantile(10.9 / 1024.0, 10), 0u);
    EXPECT_EQ(coin_quantile(11.1 / 1024.0, 10), 1u);
    EXPECT_EQ(coin_quantile(56.1 / 1024.0, 10), 2u);
}

// The four examples of Newcombe (Statistics in Medicine 17, 1998, table I, method 3: the score
// interval without continuity correction), printed with four decimals.
TEST(WilsonShare, AgreesWithTheIntervalsThatNewcombePrints) {
    const struct {
        std::size_t count, trials;
        double low, high;
    } published[] = {{81, 263, 0.2553, 0.3662},
                     {15, 148, 0.0624, 0.1605},
                     {0, 20, 0.0, 0.1611},
                     {1, 29, 0.0061, 0.1718}};
    for (const auto& each : published) {
        const Proportion share = wilson_share(each.count, each.trials);
        EXPECT_NEAR(share.low, each.low, 5e-5) << each.count;
        EXPECT_NEAR(share.high, each.high, 5e-5) << each.count;
        EXPECT_DOUBLE_EQ(share.value,
                         static_cast<double>(each.count) / static_cast<double>(each.trials));
    }
}

TEST(WilsonShare, StaysWithinItsBoundsAndRefusesImpossibleCounts) {
    EXPECT_EQ(wilson_share(7, 7).high, 1.0);
    EXPECT_LT(wilson_share(7, 7).low, 1.0);
    EXPECT_THROW(wilson_share(0, 0), NumericalError);
    EXPECT_THROW(wilson_share(8, 7), NumericalError);
}

// ---- covariance

// rad and mm: diagonal elements twelve orders of magnitude apart, and correlated.
TEST(Information, IsInvertedWhateverItsUnits) {
    Eigen::Matrix3d information;
    information << 4e9, 1.2e3, -8e4, 1.2e3, 9e-3, -0.03, -8e4, -0.03, 2.5e1;
    const auto inverse = covariance_from_information(information);
    ASSERT_TRUE(inverse);
    const Eigen::Vector3d unit = information.diagonal().cwiseSqrt();
    const Eigen::Matrix3d rest =
        unit.asDiagonal() * (*inverse) * information * unit.cwiseInverse().asDiagonal();
    EXPECT_LT((rest - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Information, HasNoInverseWhereADirectionIsUntold) {
    const Eigen::Vector3d row(1.0, -2.0, 0.5), other(0.3, 0.7, 1.1);
    EXPECT_FALSE(covariance_from_information(row * row.transpose() + other * other.transpose()));
    EXPECT_FALSE(covariance_from_information(Eigen::Vector3d(1.0, 0.0, 2.0).asDiagonal()));
    EXPECT_FALSE(covariance_from_information(
        Eigen::Vector3d(1.0, std::nan(""), 2.0).asDiagonal().toDenseMatrix()));
}

TEST(Information, TakesTheCallersBoundOfWhatIsRounding) {
    Eigen::Matrix2d information;
    information << 1.0, 0.999, 0.999, 1.0;  // eigenvalues 0.001 and 1.999
    EXPECT_TRUE(covariance_from_information(information, 0.9e-3));
    EXPECT_FALSE(covariance_from_information(information, 1.1e-3));
}

// 4000 independent groups: the scatter's elements are right to sqrt(2 / 4000) = 2.2 %.
TEST(ExcessScatter, OfIndependentGroupsIsTheirCovariance) {
    RandomStream random(7, 1);
    constexpr int groups = 4000;
    const Eigen::Vector3d deviations(1.0, 2.0, 3.0);
    Eigen::MatrixXd effects(3, groups);
    for (int i = 0; i < groups; ++i)
        for (int k = 0; k < 3; ++k)
            effects(k, i) = deviations[k] * random.normal() / std::sqrt(groups);
    const Eigen::MatrixXd found = cluster_robust_factor(effects);
    const Eigen::Matrix3d expected = deviations.cwiseAbs2().asDiagonal();
    EXPECT_LT((found - expected).norm(), 5.0 * 0.022 * expected.norm());
}

// Few groups say little of the directions: what they show of them is drawn towards the mean.
TEST(ExcessScatter, OfFewGroupsIsDrawnTowardsTheSameEverywhere) {
    RandomStream random(8, 1);
    Eigen::MatrixXd effects(6, 8);
    for (double& effect : effects.reshaped())
        effect = 2.0 * random.normal() / std::sqrt(8.0);
    const auto spread = [](const Eigen::MatrixXd& matrix) {
        const Eigen::VectorXd values = matrix.selfadjointView<Eigen::Lower>().eigenvalues();
        return values.maxCoeff() / values.minCoeff();
    };
    const Eigen::MatrixXd sandwich = effects * effects.transpose(),
                          found = cluster_robust_factor(effects);
    EXPECT_NEAR(found.trace(), sandwich.trace(), 1e-12);
    EXPECT_LT(spread(found), 0.2 * spread(sandwich));
}

TEST(ExcessScatter, IsNeverBelowTheNoise) {
    const Eigen::MatrixXd little = Eigen::MatrixXd::Constant(2, 5, 0.01);
    EXPECT_GE(cluster_robust_factor(little).trace(), 2.0 - 1e-12);
    EXPECT_EQ(cluster_robust_factor(Eigen::MatrixXd::Zero(2, 5)), Eigen::MatrixXd::Identity(2, 2));
}

// ---- random

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
