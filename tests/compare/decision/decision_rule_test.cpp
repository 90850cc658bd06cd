// JCGM 106:2012, computed here a second way: by drawing true values and measurements.

#include "compare/decision/verdict.h"
#include "compare/uncertainty/uncertainty_budget.h"
#include "core/statistics/random.h"
#include "tests/test.h"

namespace etalon {
namespace {

constexpr DecisionRule guarded, simple{0.0}, half{0.5};

JudgedQuantity quantity_of(double value, double standard_uncertainty, double limit) {
    JudgedQuantity quantity{.measured = true, .value = value};
    quantity.expanded_uncertainty = quantity.coverage_factor * standard_uncertainty;
    quantity.limit = limit;
    return quantity;
}

// The measured value is 2 standard uncertainties below its limit: P(Z < 2), tables.
TEST(DecisionRule, GivesTheProbabilityThatAValueConforms) {
    const JudgedQuantity measured = quantity_of(0.13, 0.01, 0.15);
    EXPECT_NEAR(decision_risk(measured, guarded).conformance, 0.97725, 1e-5);
    EXPECT_NEAR(decision_risk(measured, simple).conformance, 0.97725, 1e-5);
    // Student's t of 4 degrees of freedom: P(T < 2.132) = 0.95, tables.
    JudgedQuantity few = quantity_of(1.0 - 0.2132, 0.1, 1.0);
    few.degrees_of_freedom = 4.0;
    EXPECT_NEAR(decision_risk(few, guarded).conformance, 0.95, 1e-4);
}

// At the limit: P(Z > 2), P(Z > 0), P(Z > 1), tables.
TEST(DecisionRule, RisksAtTheLimitWhatItsGuardBandLeaves) {
    const double infinity = std::numeric_limits<double>::infinity();
    EXPECT_NEAR(risk_at_limit(guarded, 2.0, infinity), 0.02275, 1e-5);
    EXPECT_NEAR(risk_at_limit(simple, 2.0, infinity), 0.5, 1e-12);
    EXPECT_NEAR(risk_at_limit(half, 2.0, infinity), 0.15866, 1e-5);
    EXPECT_NEAR(risk_at_limit(guarded, coverage_factor(5.0), 5.0), 0.02275, 1e-5);
    EXPECT_NEAR(risk_at_limit(simple, coverage_factor(5.0), 5.0), 0.5, 1e-12);
    EXPECT_NEAR(risk_at_limit({2.0}, 2.0, infinity), 3.167e-5, 1e-8);
}

TEST(DecisionRule, DecidesWithItsGuardBand) {
    EXPECT_EQ(decide(0.5, 0.25, 0.75), Outcome::pass);  // value + U == limit
    EXPECT_EQ(decide(0.51, 0.25, 0.75), Outcome::inconclusive);
    EXPECT_EQ(decide(1.0, 0.25, 0.75), Outcome::inconclusive);  // value - U == limit
    EXPECT_EQ(decide(1.01, 0.25, 0.75), Outcome::fail);
    EXPECT_EQ(decide(0.7, 0.1, 0.75, half), Outcome::pass);
    EXPECT_EQ(decide(0.71, 0.1, 0.75, half), Outcome::inconclusive);
    EXPECT_EQ(decide(0.81, 0.1, 0.75, half), Outcome::fail);
    EXPECT_EQ(decide(0.75, 0.1, 0.75, simple), Outcome::pass);
    EXPECT_EQ(decide(std::nextafter(0.75, 1.0), 0.1, 0.75, simple), Outcome::fail);
}

TEST(DecisionRule, IsNamedAndSaid) {
    EXPECT_EQ(guarded.name(), "guarded");
    EXPECT_EQ(simple.name(), "simple");
    EXPECT_EQ(half.name(), "guard band 0.5 U");
    EXPECT_EQ(guarded.sentence(),
              "value + U <= limit is PASS, value - U > limit is FAIL, anything between is "
              "INCONCLUSIVE");
}

struct DrawnRisks {
    double consumer = 0.0, producer = 0.0;
};

// Cameras as the prior says, each measured once and decided.
DrawnRisks drawn(const JudgedQuantity& m, const DecisionRule& rule, const ValuePrior& prior,
                 int cameras) {
    RandomStream random(7, 3);
    DrawnRisks risks;
    for (int i = 0; i < cameras; ++i) {
        double truth = -1.0;
        while (truth < 0.0)
            truth = prior.mean + prior.deviation * random.normal();
        const double value = truth + m.expanded_uncertainty / m.coverage_factor * random.normal();
        const Outcome outcome = decide(value, m.expanded_uncertainty, m.limit, rule);
        if (truth > m.limit && outcome == Outcome::pass)
            risks.consumer += 1.0 / cameras;
        if (truth <= m.limit && outcome == Outcome::fail)
            risks.producer += 1.0 / cameras;
    }
    return risks;
}

// 3.5 standard errors of a share p of n draws.
double tolerance(double share, int draws) {
    return 3.5 * std::sqrt(share * (1.0 - share) / draws);
}

TEST(DecisionRule, HasTheGlobalRisksThatDrawnCamerasHave) {
    constexpr int cameras = 400'000;
    const JudgedQuantity m = quantity_of(0.1, 0.013, 0.16);
    const ValuePrior broad{0.11, 0.05}, cut{0.02, 0.15};
    for (const ValuePrior& prior : {broad, cut})
        for (const DecisionRule& rule : {guarded, simple, half}) {
            const DrawnRisks expected = drawn(m, rule, prior, cameras);
            const DecisionRisk risk = decision_risk(m, rule, prior);
            EXPECT_TRUE(risk.has_prior);
            EXPECT_GT(risk.consumer, 1e-5);
            EXPECT_NEAR(risk.consumer, expected.consumer, tolerance(risk.consumer, cameras));
            EXPECT_NEAR(risk.producer, expected.producer, tolerance(risk.producer, cameras));
        }
}

// A prior that is much narrower than the measurement: the risk is the prior's share above the
// limit, times the chance of a PASS there.
TEST(DecisionRule, IntegratesANarrowPriorToo) {
    const JudgedQuantity m = quantity_of(0.1, 1.0, 10.0);
    const DecisionRisk risk = decision_risk(m, simple, ValuePrior{10.0, 1e-4});
    EXPECT_NEAR(risk.consumer, 0.25, 1e-4);
    EXPECT_NEAR(risk.producer, 0.25, 1e-4);
}

TEST(DecisionRule, WithoutAPriorStatesTheMostThatAnyGives) {
    const JudgedQuantity m = quantity_of(0.1, 0.013, 0.16);
    for (const DecisionRule& rule : {guarded, simple, half}) {
        const DecisionRisk worst = decision_risk(m, rule);
        EXPECT_FALSE(worst.has_prior);
        EXPECT_EQ(worst.consumer, risk_at_limit(rule, 2.0, m.degrees_of_freedom));
        for (const double mean : {0.0, 0.1, 0.15, 0.16, 0.17, 0.3})
            for (const double deviation : {0.001, 0.01, 0.1}) {
                const DecisionRisk risk = decision_risk(m, rule, ValuePrior{mean, deviation});
                EXPECT_LE(risk.consumer, worst.consumer);
                EXPECT_LE(risk.producer, worst.producer);
            }
    }
}

// By hand: 0.16 - w -+ 1.645 u.
TEST(DecisionRule, HasAnOperatingCharacteristic) {
    const JudgedQuantity m = quantity_of(0.1, 0.01, 0.16);
    const DecisionRisk risk = decision_risk(m, half);
    EXPECT_NEAR(risk.passes_95.value(), 0.15 - 0.01645, 1e-5);
    EXPECT_NEAR(risk.passes_50.value(), 0.15, 1e-12);
    EXPECT_NEAR(risk.passes_5.value(), 0.15 + 0.01645, 1e-5);
    const JudgedQuantity blind = quantity_of(0.1, 0.1, 0.16);
    EXPECT_FALSE(decision_risk(blind, guarded).passes_50);  // 0.16 - 0.2: no camera is that good
}

TEST(DecisionRule, HasNoRisksWithoutAnUncertainty) {
    EXPECT_THROW(decision_risk(quantity_of(0.1, 0.0, 0.16), guarded), NumericalError);
    EXPECT_THROW(decision_risk(quantity_of(NAN, 0.1, 0.16), guarded), NumericalError);
}

// Three judged: any of them may let a good camera fail, all of them must let a bad one pass.
TEST(DecisionRule, OfAFamilyRisksWhatItsWorstMemberDoes) {
    std::vector<JudgedQuantity> quantities(3);
    const FamilyWiseRisk alike = family_wise_risk(quantities);
    EXPECT_EQ(alike.judged, 3);
    EXPECT_NEAR(alike.each, 0.02275, 1e-5);  // P(z > 2), tables
    EXPECT_EQ(alike.false_acceptance, alike.each);
    EXPECT_DOUBLE_EQ(alike.false_rejection, 3 * alike.each);
    EXPECT_EQ(family_wise_risk(std::vector<JudgedQuantity>(100)).false_rejection, 1.0);
    quantities[1].coverage_factor = coverage_factor(5.0);
    quantities[1].degrees_of_freedom = 5.0;
    const FamilyWiseRisk risk = family_wise_risk(quantities, {2.0});
    EXPECT_EQ(risk.each, risk_at_limit({2.0}, coverage_factor(5.0), 5.0));
    EXPECT_GT(risk.each, risk_at_limit({2.0}, 2.0, std::numeric_limits<double>::infinity()));
    EXPECT_EQ(risk.false_acceptance, risk.each);
    EXPECT_EQ(family_wise_risk(quantities, simple).false_rejection, 1.0);
}

TEST(Verdict, RefusesToJudgeWhatIsNotANumber) {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    constexpr double infinity = std::numeric_limits<double>::infinity();
    for (const auto& [value, uncertainty, limit] : {std::tuple(nan, 0.1, 1.0),
                                                    {0.1, nan, 1.0},
                                                    {0.1, 0.1, nan},
                                                    {0.1, infinity, 1.0},
                                                    {0.1, -0.1, 1.0},
                                                    {0.1, 0.1, 0.0}})
        EXPECT_THROW(decide(value, uncertainty, limit), NumericalError)
            << value << " " << uncertainty << " " << limit;
}

TEST(Verdict, FailsWhenAnythingFailsAndPassesOnlyWhenEverythingPasses) {
    using enum Outcome;
    const auto combined = [](const std::vector<Outcome>& outcomes) {
        std::vector<JudgedQuantity> quantities(outcomes.size());
        for (std::size_t i = 0; i < outcomes.size(); ++i)
            quantities[i].outcome = outcomes[i];
        return combine(quantities);
    };
    EXPECT_EQ(combined({pass, pass}), pass);
    EXPECT_EQ(combined({pass, inconclusive, fail}), fail);
    for (const Outcome outcome : {inconclusive, not_observable, skipped})
        EXPECT_EQ(combined({pass, outcome}), inconclusive);
    EXPECT_EQ(combined({}), inconclusive);
}

}  // namespace
}  // namespace etalon
