#include "compare/uncertainty/uncertainty_budget.h"

#include "tests/test.h"

namespace etalon {
namespace {

BudgetRow row(const std::string& source, std::optional<double> uncertainty, double sensitivity,
              double degrees_of_freedom = std::numeric_limits<double>::infinity()) {
    return {.source = source,
            .standard_uncertainty = uncertainty,
            .unit = "mm",
            .degrees_of_freedom = degrees_of_freedom,
            .sensitivity = {{"y", sensitivity}}};
}

// Coverage factors for 95.45 % two-sided, the same as 97.72 % one-sided: GUM, table G.2.
TEST(UncertaintyBudget, TakesCoverageFactorsFromStudentsDistribution) {
    EXPECT_NEAR(coverage_factor(1), 13.97, 0.005);
    EXPECT_NEAR(coverage_factor(7), 2.43, 0.005);
    EXPECT_NEAR(coverage_factor(50), 2.05, 0.005);
    EXPECT_NEAR(coverage_factor(7.9), 2.43, 0.005);  // not rounded up (G.4.1)
    EXPECT_NEAR(coverage_factor(4999), 2.0, 0.001);
    EXPECT_EQ(coverage_factor(std::numeric_limits<double>::infinity()), 2.0);
}

// Contributions 3 (5 degrees of freedom) and 4: standard 5, 5^4 / (3^4 / 5) = 38.58 degrees.
TEST(UncertaintyBudget, AddsInQuadratureWithEffectiveDegreesOfFreedom) {
    const std::vector<BudgetRow> budget{row("a", 1.5, 2.0, 5.0), row("b", 8.0, 0.5)};
    EXPECT_DOUBLE_EQ(budget[0].contribution("y"), 3.0);
    EXPECT_EQ(budget[0].contribution("other"), 0.0);
    const CombinedUncertainty result = combined(budget, "y");
    EXPECT_DOUBLE_EQ(result.standard, 5.0);
    EXPECT_NEAR(result.degrees_of_freedom, 625.0 / (81.0 / 5.0), 1e-9);
    EXPECT_DOUBLE_EQ(result.coverage_factor, coverage_factor(38.0));
    EXPECT_DOUBLE_EQ(result.expanded, 5.0 * result.coverage_factor);
    EXPECT_EQ(combined(budget, "other").expanded, 0.0);
}

TEST(UncertaintyBudget, LeavesOutWhatIsNotCounted) {
    std::vector<BudgetRow> budget{row("a", 3.0, 1.0), row("b", 4.0, 1.0)};
    budget[1].counted = false;
    EXPECT_DOUBLE_EQ(combined(budget, "y").standard, 3.0);
    budget[1].standard_uncertainty.reset();
    EXPECT_THAT(unknown_sources(budget, "y", true), IsEmpty());
}

TEST(UncertaintyBudget, KnowsWhichUnknownInputsReachAQuantity) {
    std::vector<BudgetRow> budget{row("known", 3.0, 1.0), row("unbounded", {}, 1.0),
                                  row("bounded", {}, 2.0), row("without effect", {}, 0.0)};
    budget[2].widest = 2.0;
    EXPECT_THAT(unknown_sources(budget, "y", true), ElementsAre("unbounded"));
    EXPECT_THAT(unknown_sources(budget, "y", false), ElementsAre("bounded"));
    EXPECT_THAT(unknown_sources(budget, "other", true), IsEmpty());
    EXPECT_DOUBLE_EQ(combined(budget, "y").standard, 3.0);
    EXPECT_DOUBLE_EQ(combined(budget, "y", true).standard, 5.0);  // 3 and 2 x 2
}

TEST(UncertaintyBudget, RefusesFiguresThatAreNoUncertainties) {
    for (const double bad : {-1.0, std::nan(""), std::numeric_limits<double>::infinity()})
        EXPECT_THROW(combined(std::vector{row("a", bad, 1.0)}, "y"), NumericalError);
    EXPECT_THROW(combined(std::vector{row("a", 1.0, 1.0, 0.5)}, "y"), NumericalError);
}

}  // namespace
}  // namespace etalon
