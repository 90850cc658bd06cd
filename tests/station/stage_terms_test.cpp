#include "station/stage_terms.h"

#include <gtest/gtest.h>

#include <numbers>

namespace etalon {
namespace {

std::vector<Axis> xy_rz() {
    std::vector<Axis> axes(3);
    axes[0].name = "x";
    axes[0].direction = {1, 0, 0};
    axes[0].scale_uncertainty = 30e-6;
    axes[0].repeatability = 0.004;
    axes[1].name = "y";
    axes[1].direction = {0, 1, 0};
    axes[2].name = "rz";
    axes[2].kind = Axis::Kind::rotary;
    axes[2].direction = {0, 0, 1};
    axes[2].repeatability = 1e-4;
    return axes;
}

const std::vector<std::vector<double>> positions = {{70, -50, 0.0}, {-30, 20, 1.2}};

const DeclaredStageTerm& named(const std::vector<DeclaredStageTerm>& terms,
                               const std::string& name) {
    for (const DeclaredStageTerm& term : terms)
        if (term.error.name == name)
            return term;
    throw std::out_of_range(name);
}

TEST(StageTerms, ScaleMovesTheCarriageInProportionToTheReading) {
    const auto terms = declared_stage_terms(xy_rz(), positions);
    const DeclaredStageTerm& x = named(terms, "stage scale x");
    EXPECT_TRUE(x.in_budget);
    EXPECT_TRUE(x.is_linear_scale);
    EXPECT_EQ(x.standard_uncertainty, 30e-6);
    const double moved =
        x.error.base_from_carriage[0].translation.x() / x.error.size - 70 / x.error.size;
    EXPECT_NEAR(moved, 70.0, 1e-6);
}

TEST(StageTerms, AnUndeclaredScaleIsUnknownAndStaysInTheBudget) {
    const auto terms = declared_stage_terms(xy_rz(), positions);
    EXPECT_TRUE(named(terms, "stage scale y").in_budget);
    EXPECT_FALSE(named(terms, "stage scale y").standard_uncertainty);
    EXPECT_FALSE(named(terms, "stage scale rz").is_linear_scale);
}

TEST(StageTerms, SquarenessLeansTheSecondAxisTowardsTheFirst) {
    const auto terms = declared_stage_terms(xy_rz(), positions);
    EXPECT_EQ(terms.size(), 4u);
    const DeclaredStageTerm& xy = named(terms, "stage squareness xy");
    EXPECT_FALSE(xy.in_budget);
    EXPECT_EQ(xy.error.unit, "rad");
    // y = -50 moves x by -50 times the angle.
    EXPECT_NEAR((xy.error.base_from_carriage[0].translation.x() - 70) / xy.error.size, -50, 1e-4);
}

// The marker's centre is 30 mm right and 40 mm down of the rotary axis: 50 mm away.
TEST(StageTerms, RepeatabilityOfARotaryAxisIsAnArcAtTheMarker) {
    const Rigid mount{Eigen::Quaterniond::Identity(), {30, 40, 7}};
    const auto terms = declared_repeatability(xy_rz(), positions, mount);
    ASSERT_EQ(terms.size(), 3u);
    EXPECT_NEAR(*terms[0].marker_mm, 0.004, 1e-12);
    EXPECT_FALSE(terms[1].marker_mm);
    EXPECT_NEAR(*terms[2].marker_mm, 50 * 1e-4, 1e-9);
}

}  // namespace
}  // namespace etalon
