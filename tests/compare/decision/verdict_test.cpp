#include "compare/decision/verdict.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "core/program/errors.h"

namespace etalon {
namespace {

std::vector<JudgedQuantity> with(const std::vector<Outcome>& outcomes) {
    std::vector<JudgedQuantity> quantities;
    for (const Outcome outcome : outcomes) {
        quantities.emplace_back();
        quantities.back().outcome = outcome;
    }
    return quantities;
}

TEST(Verdict, KeepsAGuardBandOfUOnBothSidesOfTheLimit) {
    EXPECT_EQ(decide(0.5, 0.25, 0.75), Outcome::pass);  // value + U == limit
    EXPECT_EQ(decide(0.51, 0.25, 0.75), Outcome::inconclusive);
    EXPECT_EQ(decide(1.0, 0.25, 0.75), Outcome::inconclusive);  // value - U == limit
    EXPECT_EQ(decide(1.01, 0.25, 0.75), Outcome::fail);
}

TEST(Verdict, RefusesToJudgeWhatIsNotANumber) {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    constexpr double infinity = std::numeric_limits<double>::infinity();
    EXPECT_THROW(decide(nan, 0.1, 1.0), NumericalError);
    EXPECT_THROW(decide(0.1, nan, 1.0), NumericalError);
    EXPECT_THROW(decide(0.1, 0.1, nan), NumericalError);
    EXPECT_THROW(decide(0.1, infinity, 1.0), NumericalError);
    EXPECT_THROW(decide(0.1, -0.1, 1.0), NumericalError);
    EXPECT_THROW(decide(0.1, 0.1, 0.0), NumericalError);
}

TEST(Verdict, FailsWhenAnythingFailsAndPassesOnlyWhenEverythingPasses) {
    using enum Outcome;
    EXPECT_EQ(combine(with({pass, pass})), pass);
    EXPECT_EQ(combine(with({pass, inconclusive, fail})), fail);
    for (const Outcome outcome : {inconclusive, not_observable, skipped})
        EXPECT_EQ(combine(with({pass, outcome})), inconclusive);
    EXPECT_EQ(combine({}), inconclusive);
}

// Three judged: any of them may let a good camera fail, all of them must let a bad one pass.
TEST(Verdict, StatesWhatItRisksOverAllQuantities) {
    const FamilyRisk risk = family_risk(std::vector<JudgedQuantity>(3));
    EXPECT_EQ(risk.judged, 3);
    EXPECT_NEAR(risk.each, 0.02275, 1e-5);  // P(z > 2), tables
    EXPECT_EQ(risk.false_acceptance, risk.each);
    EXPECT_DOUBLE_EQ(risk.false_rejection, 3 * risk.each);
    EXPECT_EQ(family_risk(std::vector<JudgedQuantity>(100)).false_rejection, 1.0);
}

}  // namespace
}  // namespace etalon
