#include "station/setup/stage_terms.h"

#include "stage/axes/kinematics.h"
#include "tests/test.h"

namespace etalon {
namespace {

std::vector<Axis> xy_rz() {
    return {
        {.name = "x", .direction = {1, 0, 0}, .scale_uncertainty = 30e-6, .repeatability = 0.004},
        {.name = "y", .direction = {0, 1, 0}},
        {.name = "rz", .kind = Axis::Kind::rotary, .repeatability = 1e-4}};
}

VisitedPose visited(const std::vector<double>& position) {
    VisitedPose pose;
    pose.read_back = position;
    pose.read_back_uncertainty.assign(position.size(), 0.0);
    return pose;
}

const std::vector<VisitedPose> visits = {visited({70, -50, 0.0}), visited({-30, 20, 1.2})};

const DeclaredStageTerm& named(const std::vector<DeclaredStageTerm>& terms,
                               const std::string& name) {
    for (const DeclaredStageTerm& term : terms)
        if (term.error.name == name)
            return term;
    throw std::out_of_range(name);
}

TEST(StageTerms, ScaleMovesTheCarriageInProportionToTheReading) {
    const auto terms = declared_stage_terms(xy_rz(), visits);
    const DeclaredStageTerm& x = named(terms, "stage scale x");
    EXPECT_TRUE(x.in_budget);
    EXPECT_TRUE(x.error.is_linear_scale);
    EXPECT_EQ(x.standard_uncertainty, 30e-6);
    const double moved =
        x.error.base_from_carriage[0].translation.x() / x.error.size - 70 / x.error.size;
    EXPECT_NEAR(moved, 70.0, 1e-6);
}

TEST(StageTerms, AnUndeclaredScaleIsUnknownAndStaysInTheBudget) {
    const auto terms = declared_stage_terms(xy_rz(), visits);
    EXPECT_TRUE(named(terms, "stage scale y").in_budget);
    EXPECT_FALSE(named(terms, "stage scale y").standard_uncertainty);
    EXPECT_FALSE(named(terms, "stage scale rz").error.is_linear_scale);
}

TEST(StageTerms, SquarenessLeansTheSecondAxisTowardsTheFirst) {
    const auto terms = declared_stage_terms(xy_rz(), visits);
    EXPECT_EQ(terms.size(), 4u);
    const DeclaredStageTerm& xy = named(terms, "stage squareness xy");
    EXPECT_FALSE(xy.in_budget);
    EXPECT_EQ(xy.error.unit, "rad");
    // y = -50 moves x by -50 times the angle.
    EXPECT_NEAR((xy.error.base_from_carriage[0].translation.x() - 70) / xy.error.size, -50, 1e-4);
}

TEST(StageTerms, ScaleStretchesFromTheZeroOfTheAxis) {
    auto axes = xy_rz();
    axes[0].zero = 30;
    const auto terms = declared_stage_terms(axes, visits);
    const DeclaredStageTerm& x = named(terms, "stage scale x");
    EXPECT_NEAR((x.error.base_from_carriage[0].translation.x() - 40) / x.error.size, 40.0, 1e-6);
}

// Of a direction and a point that are declared there is a term for each way across.
TEST(StageTerms, DirectionAndPointCanBeOffInTwoWays) {
    auto axes = xy_rz();
    axes[1].direction_uncertainty = 50e-6;
    axes[2].point_uncertainty = 0.07;
    const auto terms = declared_stage_terms(axes, visits);
    EXPECT_EQ(terms.size(), 8u);
    const DeclaredStageTerm& first = named(terms, "stage direction y, 1st way");
    const DeclaredStageTerm& second = named(terms, "stage direction y, 2nd way");
    EXPECT_TRUE(first.in_budget);
    EXPECT_EQ(first.standard_uncertainty, 50e-6);
    const auto moved = [&](const DeclaredStageTerm& term, std::size_t pose) -> Eigen::Vector3d {
        const Rigid straight = base_from_carriage(axes, visits[pose].read_back);
        return (term.error.base_from_carriage[pose].translation - straight.translation) /
               term.error.size;
    };
    // y = -50: 50 mm times the angle, across y, in two directions at right angles.
    EXPECT_NEAR(moved(first, 0).norm(), 50, 1e-2);
    EXPECT_NEAR(moved(second, 0).norm(), 50, 1e-2);
    EXPECT_NEAR(moved(first, 0).dot(moved(second, 0)), 0, 1e-1);
    EXPECT_NEAR(moved(first, 0).y(), 0, 1e-2);
    // A turn by 1.2 rad about a point that is off by s moves everything by 2 s sin(0.6).
    const DeclaredStageTerm& point = named(terms, "stage point rz, 2nd way");
    EXPECT_EQ(point.error.unit, "mm");
    EXPECT_EQ(point.standard_uncertainty, 0.07);
    EXPECT_NEAR(moved(point, 0).norm(), 0, 1e-9);
    EXPECT_NEAR(moved(point, 1).norm(), 2 * std::sin(0.6), 1e-9);
}

TEST(StageTerms, RepeatabilityHoldsTheBacklashAndTheReading) {
    auto axes = xy_rz();
    axes[0].backlash = 0.006;  // half of it up or down: 3 um beside the repeatability's 4
    auto read = visits;
    read[0].read_back_uncertainty[0] = read[1].read_back_uncertainty[0] = 0.012;
    const auto terms = declared_repeatability(axes, read, {});
    EXPECT_NEAR(*terms[0].marker_mm, 0.013, 1e-12);
}

// 3 um at x = 70 and 7 um at x = -30, whatever the other axes do.
TEST(StageTerms, AnErrorMapCountsWithWhatItDoesToTheMarker) {
    auto axes = xy_rz();
    EXPECT_TRUE(declared_error_maps(axes, visits, {}).empty());
    axes[0].errors = ErrorMap({{-30, 0.1, 0.007}, {70, 0.2, 0.003}}, {"test"});
    const auto maps = declared_error_maps(axes, visits, {});
    ASSERT_EQ(maps.size(), 1u);
    EXPECT_EQ(maps[0].axis, "x");
    EXPECT_NEAR(maps[0].marker_rms_mm, std::sqrt((9.0 + 49.0) / 2) * 1e-3, 1e-12);
    EXPECT_NEAR(maps[0].marker_max_mm, 0.007, 1e-12);
}

// The marker's centre is 30 mm right and 40 mm down of the rotary axis: 50 mm away.
TEST(StageTerms, RepeatabilityOfARotaryAxisIsAnArcAtTheMarker) {
    const Rigid mount{Eigen::Quaterniond::Identity(), {30, 40, 7}};
    const auto terms = declared_repeatability(xy_rz(), visits, mount);
    ASSERT_EQ(terms.size(), 3u);
    EXPECT_NEAR(*terms[0].marker_mm, 0.004, 1e-12);
    EXPECT_FALSE(terms[1].marker_mm);
    EXPECT_NEAR(*terms[2].marker_mm, 50 * 1e-4, 1e-9);
}

}  // namespace
}  // namespace etalon
