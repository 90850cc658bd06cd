#include "compare/qualification/qualification.h"

#include "compare/qualification/judged_quantities.h"
#include "tests/compare/qualification/simulated_run.h"
#include "tests/test.h"

namespace etalon {
namespace {

Qualification qualified(const SimulatedRun& run, std::uint64_t seed = 1) {
    return qualify(input_of(run, seed));
}

TEST(Qualification, PassesAPerfectCamera) {
    const Qualification result = qualified(demo_run());
    EXPECT_EQ(result.verdict, Outcome::pass);
    EXPECT_TRUE(result.budget_complete);
    EXPECT_EQ(result.detection.rate(), 1.0);
    ASSERT_EQ(result.quantities.size(), 2u);
    EXPECT_EQ(result.quantities[0].name, "b3_position_field_rms_mm");
    EXPECT_THAT(result.reasons, IsEmpty());
}

TEST(Qualification, FailsAWrongFocalLengthAndAWrongDistortion) {
    SimulatedRun focal = demo_run(), distorted = demo_run();
    focal.true_camera.intrinsics.zoom(1.005);
    distorted.true_camera.distortion.k1 *= 1.1;
    EXPECT_EQ(qualified(focal).verdict, Outcome::fail);
    EXPECT_EQ(qualified(distorted).verdict, Outcome::fail);
}

TEST(Qualification, NeverPassesAStageWhoseScaleIsWrong) {
    for (std::size_t axis = 0; axis < 3; ++axis)
        for (const double error : {2e-3, -2e-3}) {
            SimulatedRun run = demo_run();
            run.true_scale[axis] += error;
            EXPECT_NE(qualified(run).verdict, Outcome::pass) << axis << " " << error;
        }
}

// A detector that is wrong in the same way in photo and render says nothing about the camera.
TEST(Qualification, PassesATrueCameraSeenThroughADetectorThatIsWrongOnPurpose) {
    SimulatedRun run = demo_run();
    run.detector = [](const Corners& corners) { return moved_outwards(corners, -0.3); };
    const Qualification shrunk = qualified(run);
    EXPECT_EQ(shrunk.verdict, Outcome::pass);
    for (const JudgedQuantity& quantity : shrunk.quantities)
        EXPECT_LT(quantity.value, quantity.expanded_uncertainty) << quantity.name;
    double b1_z = 0.0;  // reported, and large
    for (const AnalysedPose& pose : shrunk.poses)
        if (pose.bias.b1)
            b1_z = std::max(b1_z, pose.bias.b1->translation_mm.z());
    EXPECT_GT(b1_z, 1.0);
}

TEST(Qualification, DoesNotPassWithATermOfTheBudgetUnknown) {
    const SimulatedRun run = demo_run();
    for (int term = 0; term < 3; ++term) {
        QualificationInput input = input_of(run, 1);
        if (term == 0)
            input.marker_size_uncertainty.reset();
        else if (term == 1)
            input.stage_terms[2].standard_uncertainty.reset();
        else
            input.repeatability[1].marker_mm.reset();
        const Qualification result = qualify(input);
        EXPECT_EQ(result.verdict, Outcome::inconclusive);
        EXPECT_FALSE(result.budget_complete);
        EXPECT_THAT(result.reasons, Contains(HasSubstr("unknown")));
        EXPECT_EQ(std::count_if(result.budget.begin(), result.budget.end(),
                                [](const BudgetRow& row) {
                                    return row.counted && !row.standard_uncertainty;
                                }),
                  1);
    }
}

// Standard uncertainties of 0.03 mm RMS and 0.07 mm at most count twice (k = 2) at least.
TEST(Qualification, CountsAnErrorMapInFull) {
    QualificationInput input = demo_input();
    const Qualification without = qualify(input);
    input.error_maps = {{"z", 0.03, 0.07}};
    const Qualification with = qualify(input);
    const auto row = std::ranges::find(with.budget, "stage error map z", &BudgetRow::source);
    ASSERT_NE(row, with.budget.end());
    EXPECT_DOUBLE_EQ(row->contribution(quantity::position_rms), 0.03);
    EXPECT_DOUBLE_EQ(row->contribution(quantity::position_max), 0.07);
    EXPECT_EQ(with.budget.size(), without.budget.size() + 1);
    EXPECT_GT(with.quantities[0].expanded_uncertainty, 2 * 0.03);
    EXPECT_GT(with.quantities[1].expanded_uncertainty, 2 * 0.07);
    EXPECT_LT(without.quantities[1].expanded_uncertainty, with.quantities[1].expanded_uncertainty);
}

TEST(Qualification, SkipsItsQuantitiesWhenTooFewPosesWereDetected) {
    QualificationInput input = demo_input();
    for (std::size_t i = 36; i < input.poses.size(); ++i)
        input.poses[i].corners.clear();
    const Qualification result = qualify(input);
    EXPECT_EQ(result.verdict, Outcome::inconclusive);
    EXPECT_EQ(result.detection.hold_out_detected, 6);
    for (const JudgedQuantity& quantity : result.quantities) {
        EXPECT_EQ(quantity.outcome, Outcome::skipped);
        EXPECT_THAT(quantity.reason, HasSubstr("6 hold-out"));
    }
}

TEST(Qualification, GoesOnWithoutTheFewPosesThatWereNotDetected) {
    QualificationInput input = demo_input();
    for (const std::size_t i : {2, 19, 44, 61})
        input.poses[i].corners.clear();
    // The marker may have been turned away there: such a pose cannot be rendered.
    std::vector<Eigen::Vector3d> rendered_at;
    const auto render = input.render_and_detect;
    input.render_and_detect = [&](const Rigid& at) {
        rendered_at.push_back(at.translation);
        return render(at);
    };
    const Qualification result = qualify(input);
    EXPECT_THAT(rendered_at, Contains(result.poses[45].bias.predicted.translation));
    EXPECT_THAT(rendered_at, Not(Contains(result.poses[44].bias.predicted.translation)));
    EXPECT_EQ(result.verdict, Outcome::pass);
    EXPECT_NEAR(result.detection.rate(), 66.0 / 70.0, 1e-12);
    EXPECT_FALSE(result.poses[44].used);
    EXPECT_FALSE(result.poses[44].bias.b3);
}

TEST(Qualification, JudgesRotationsWhenTheLimitsAskForThem) {
    SimulatedRun run = demo_run();
    run.limits.b3_rotation_field_rms_mrad = 2.0;
    run.limits.b3_rotation_field_max_mrad = 6.0;
    const Qualification result = qualified(run);
    ASSERT_EQ(result.quantities.size(), 4u);
    EXPECT_EQ(result.quantities[2].outcome, Outcome::pass);
    EXPECT_EQ(result.quantities[3].unit, "mrad");
    EXPECT_EQ(result.quantities[3].outcome, Outcome::pass);
}

TEST(Qualification, RefusesInputThatIsNotFinite) {
    QualificationInput input = demo_input();
    input.poses[3].corners.at(1).x() = std::numeric_limits<double>::quiet_NaN();
    EXPECT_THROW(qualify(input), NumericalError);
    input = demo_input();
    input.poses[3].corners.pop_back();
    EXPECT_THROW(qualify(input), NumericalError);
    input = demo_input();
    input.poses[50].base_from_carriage.translation.y() = std::numeric_limits<double>::infinity();
    EXPECT_THROW(qualify(input), NumericalError);
}

ImageAgreement blurry() {
    ImageAgreement match;
    match.photos = 40;
    match.blur_px = PixelFigure{-0.21, 0.03};
    match.findings = {"the photographs are sharper than the calibration says"};
    return match;
}

TEST(Qualification, ReportsPixelsWithoutALimitAndPasses) {
    QualificationInput input = demo_input();
    input.pixels = blurry();
    const Qualification result = qualify(input);
    EXPECT_EQ(result.verdict, Outcome::pass);
    const auto blur =
        std::ranges::find(result.reported, quantity::pixel_blur, &JudgedQuantity::name);
    ASSERT_NE(blur, result.reported.end());
    EXPECT_EQ(blur->value, 0.21);
    EXPECT_EQ(blur->expanded_uncertainty, 0.03);
    EXPECT_EQ(blur->coverage_factor, 3.0);
    const auto tone =
        std::ranges::find(result.reported, quantity::pixel_tone, &JudgedQuantity::name);
    EXPECT_FALSE(tone->measured);
}

TEST(Qualification, JudgesPixelsByTheirLimits) {
    for (const auto& [limit, expected] :
         {std::pair(0.30, Outcome::pass), std::pair(0.22, Outcome::inconclusive),
          std::pair(0.10, Outcome::fail)}) {
        QualificationInput input = demo_input();
        input.limits.pixel_blur_px = limit;
        input.pixels = blurry();
        EXPECT_EQ(qualify(input).verdict, expected) << limit;
    }
}

TEST(Qualification, FailsPixelsThatMustMatch) {
    QualificationInput input = demo_input();
    input.limits.pixels_must_match = true;
    input.pixels = blurry();
    const Qualification result = qualify(input);
    EXPECT_EQ(result.verdict, Outcome::fail);
    EXPECT_THAT(result.reasons, Contains(HasSubstr("the pixels do not match")));
    input.pixels->findings.clear();
    EXPECT_EQ(qualify(input).verdict, Outcome::pass);
    input.pixels.reset();
    EXPECT_EQ(qualify(input).verdict, Outcome::inconclusive);
}

TEST(Qualification, MeasuresNothingThatIsOverexposed) {
    QualificationInput input = demo_input();
    input.pixels = ImageAgreement{};
    input.pixels->is_overexposed = true;
    const Qualification result = qualify(input);
    EXPECT_EQ(result.verdict, Outcome::inconclusive);
    for (const JudgedQuantity& quantity : result.quantities)
        EXPECT_EQ(quantity.outcome, Outcome::skipped);
    EXPECT_THAT(result.reasons, Contains(HasSubstr("overexposed")));
    ASSERT_TRUE(result.causes && result.causes->named());
    EXPECT_EQ(result.causes->named()->text(), "overexposed");
}

// Only the figures that have a limit, and those as they are beside all others.
TEST(Qualification, MeasuresNothingElseWhereOnlyVerdictsAreRead) {
    QualificationInput input = demo_input(12);
    const Qualification all = qualify(input);
    const NoiseDraws draws(input.options.seed);
    input.options.known_draws = &draws;
    input.options.measure_reported = false;
    const Qualification judged = qualify(input);
    EXPECT_TRUE(judged.reported.empty());
    EXPECT_FALSE(judged.rotation_field || judged.lengths);
    ASSERT_EQ(judged.quantities.size(), all.quantities.size());
    for (std::size_t i = 0; i < all.quantities.size(); ++i) {
        EXPECT_EQ(judged.quantities[i].value, all.quantities[i].value);
        EXPECT_EQ(judged.quantities[i].expanded_uncertainty,
                  all.quantities[i].expanded_uncertainty);
        EXPECT_EQ(judged.quantities[i].outcome, all.quantities[i].outcome);
    }
    EXPECT_EQ(judged.verdict, all.verdict);
}

}  // namespace
}  // namespace etalon
