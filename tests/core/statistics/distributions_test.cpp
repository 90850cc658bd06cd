#include "core/statistics/distributions.h"

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

}  // namespace
}  // namespace etalon
