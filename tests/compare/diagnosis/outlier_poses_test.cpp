// Truth: fields and runs with poses that were put elsewhere.
#include "compare/diagnosis/outlier_poses.h"

#include "tests/compare/qualification/simulated_run.h"
#include "tests/compare/uncertainty/field_samples.h"
#include "tests/test.h"

namespace etalon {
namespace {

std::vector<OutlierPose> outlying_of(const std::vector<FieldSample>& all, double least_mm) {
    return outlying_samples(all, fit_smooth_field(all, FieldBasis::position), least_mm);
}

TEST(OutlyingSamples, AreFoundWithHowFarTheyAreOff) {
    auto all = field_samples::samples(40, 1.0, 0.05, 5);
    EXPECT_TRUE(outlying_of(all, 0.2).empty());
    const Eigen::Vector3d off(96.0, -3.0, 7.0), other(0.0, 2.0, -30.0);
    all[17].error += off;
    all[5].error += other;
    const auto found = outlying_of(all, 0.2);
    ASSERT_EQ(found.size(), 2u);
    EXPECT_EQ(found[0].index, 17u);
    EXPECT_EQ(found[1].index, 5u);
    EXPECT_LT((found[0].off_mm - off).norm(), 0.3);  // noise and the field's own uncertainty there
    EXPECT_LT((found[1].off_mm - other).norm(), 0.3);
}

// 40 samples may lose two.
TEST(OutlyingSamples, AreNoneWhereTheyAreMany) {
    auto all = field_samples::samples(40, 1.0, 0.05, 5);
    for (const std::size_t i : {3u, 17u, 29u})
        all[i].error += Eigen::Vector3d(0.0, 20.0 + static_cast<double>(i), 0.0);
    EXPECT_TRUE(outlying_of(all, 0.2).empty());
    EXPECT_EQ(max_outlying(40), 2u);
    EXPECT_EQ(max_outlying(15), 1u);
}

TEST(OutlyingSamples, AreNoneThatAreNearerThanWhatCounts) {
    auto all = field_samples::samples(40, 1.0, 0.001, 5);
    all[17].error += Eigen::Vector3d(0.1, 0.0, 0.0);
    EXPECT_EQ(outlying_of(all, 0.05).size(), 1u);
    EXPECT_TRUE(outlying_of(all, 0.16).empty());
}

// The stage stands 40 mm aside of where it says, at a hold-out pose and at a training pose. What is
// left is a camera without an error, and nobody may sign that it passes.
TEST(OutlyingPoses, AreLeftOutAndWithholdPass) {
    for (const std::size_t wrong : {43u, 12u}) {
        SimulatedRun run = demo_run();
        run.misread = [wrong](std::vector<double>& q, std::size_t i) {
            if (i == wrong)
                q[1] += q[1] > 0.0 ? -40.0 : 40.0;
        };
        run.look_for_causes = true;
        const Qualification result = qualify(input_of(run, 1));
        ASSERT_TRUE(result.causes->named());
        EXPECT_EQ(result.causes->named()->text(), fmt::format("pose {} does not fit", wrong));
        const std::string expected = fmt::format("pose {} along y by (39|40)[.0-9]* mm", wrong);
        EXPECT_THAT(result.outlying, ElementsAre(testing::Field(&RejectedPose::text,
                                                                testing::ContainsRegex(expected))));
        EXPECT_EQ(result.verdict, Outcome::inconclusive) << wrong;
        EXPECT_FALSE(result.poses[wrong].used);
        for (const JudgedQuantity& each : result.quantities)
            EXPECT_EQ(each.outcome, Outcome::pass) << each.name << " without pose " << wrong;
    }
}

// Corners lie aside while the photographs' pixels show the marker at its place: the detector
// slipped, the stage did not, and the field's robust fit bears one such pose.
TEST(OutlyingPoses, AreNotThoseWhereOnlyTheDetectorSlipped) {
    SimulatedRun run = demo_run();
    QualificationInput input = input_of(run, 1);
    for (const std::size_t slipped : {43u, 12u}) {
        VisitedPose& pose = input.poses[slipped];
        pose.seen_at = run.camera_from_base * pose.base_from_carriage * run.carriage_from_marker;
        pose.detector_bias_px.assign(4, Eigen::Vector2d::Zero());
        pose.corners = moved_by(pose.corners, {0.8, -0.6});
    }
    EXPECT_TRUE(qualify(input).outlying.empty());
    for (const std::size_t slipped : {43u, 12u})
        input.poses[slipped].seen_at.reset();
    EXPECT_EQ(qualify(input).outlying.size(), 2u);
}

}  // namespace
}  // namespace etalon
