// Truth: corners simulated forwards from a wrong camera, marker or stage; the search never sees how
// they were made.
#include "compare/diagnosis/causes.h"

#include "compare/diagnosis/error_signatures.h"
#include "compare/diagnosis/outlier_poses.h"
#include "tests/compare/qualification/injected_errors.h"
#include "tests/compare/uncertainty/field_samples.h"
#include "tests/test.h"

namespace etalon {
namespace {

using testing::SizeIs;

Cause named_in(const Causes& causes) {
    if (!causes.named())
        throw NumericalError("no cause is named");
    return *causes.named();
}

TEST(Causes, NameNobodyWhereNothingIsWrong) {
    const Causes causes = causes_of(demo_run(), 3);
    EXPECT_EQ(causes.named(), nullptr);
    EXPECT_GT(causes.no_error, 0.95);
    EXPECT_NEAR(causes.scatter, 1.0, 0.1);
}

TEST(Causes, NameAnAspectWithItsSize) {
    SimulatedRun run = demo_run();
    run.true_camera.intrinsics.fy *= 1.003;
    const Causes causes = causes_of(run, 4);
    const Cause cause = named_in(causes);
    const CausingError& error = cause.errors.front();
    EXPECT_EQ(cause.text(), "aspect of fx, fy");
    EXPECT_LT(error.expanded_uncertainty, 1e-4);
    EXPECT_NEAR(error.size, 0.003, 1.5 * error.expanded_uncertainty);
    EXPECT_THAT(error.remedies.front(), HasSubstr("calibrate the camera again"));
    EXPECT_LT(causes.no_error + causes.none_of_these, 1e-6);
}

TEST(Causes, NameWhatNobodyCanTellApartTogether) {
    SimulatedRun run = demo_run();
    run.marker_scale = 1.001;
    EXPECT_THAT(named_in(causes_of(run, 6)).errors.front().names,
                testing::UnorderedElementsAre("marker print size", "stage scale, all linear axes"));
}

// The plan's positions lie on a grid of 240 / 128 mm: frequencies that differ by that of the grid
// look alike, and the longest period is named first.
TEST(Causes, NameTheLongestPeriodThatExplainsAnAxis) {
    SimulatedRun run = demo_run();
    run.misread = [](std::vector<double>& q, std::size_t) {
        q[0] += 0.03 * std::sin(2.0 * std::numbers::pi * q[0] / 5.0);
    };
    const Cause cause = named_in(causes_of(run, 7));
    EXPECT_THAT(
        cause.text(),
        testing::ContainsRegex("^x repeats with a period of (15 mm or )?(4.99|5|5.01) mm or 3 mm"));
    EXPECT_NEAR(cause.errors.front().size, 0.03, 0.006);
}

// So far off that a pose in the image's corner lies where the field of the others does not put it:
// the same error explains it, and nobody is sent to look at the stage.
TEST(Causes, BlameNoLeftOutPoseThatTheErrorExplains) {
    SimulatedRun run = demo_run();
    run.true_camera.distortion.s2 += 0.015;
    run.look_for_causes = true;
    const Qualification result = qualify(input_of(run, 999));
    EXPECT_EQ(result.outlying.size(), 1u);
    EXPECT_EQ(named_in(*result.causes).text(), "thin prism s2");
}

// A shift along y with a turn about it is, with these corners, as well half a pixel both ways with
// a tilt: two errors for two others.
TEST(Causes, NameWholeExplanationsThatNobodyCanTellApart) {
    SimulatedRun run = demo_run();
    run.true_camera.intrinsics.cy += 0.84;
    run.true_camera.distortion.s1 += 6e-4;
    const Cause cause = named_in(causes_of(run, 1004));
    EXPECT_THAT(cause.text(),
                AllOf(HasSubstr("c_y and thin prism s1"),
                      HasSubstr("half pixel and sensor tilt tau_y"), HasSubstr(", or ")));
    EXPECT_GT(cause.probability, 0.95);
}

// A radial term and a decentring: sets of four explain the same, each less probable.
TEST(Causes, NameLargerSetsBesideTheBest) {
    SimulatedRun run = demo_run();
    run.true_camera.distortion.k3 += 0.048;
    run.true_camera.distortion.p1 += 6e-4;
    run.true_camera.distortion.p2 -= 4e-4;
    const Cause cause = named_in(causes_of(run, 1006));
    EXPECT_THAT(cause.text(), StartsWith("p1 and p2 and k6 ~ k3"));
    EXPECT_EQ(cause.errors.size(), 3u);
    EXPECT_GT(cause.probability, 0.95);
    ASSERT_GT(cause.instead.size(), 2u);
    EXPECT_THAT(cause.instead, testing::Each(SizeIs(4)));
    EXPECT_THAT(cause.alternatives(), SizeIs(3));
    EXPECT_THAT(cause.text(),
                EndsWith(fmt::format(", or one of {} other sets", cause.instead.size() - 2)));
}

// One pose's corners lie 0.15 px aside. Where its pixels show the marker at its place the detector
// slipped, and nothing is wrong; where they show it aside, too, or nobody asked them, it was there.
TEST(Causes, BlameNoPoseWhereOnlyTheDetectorSlipped) {
    const auto named = [](bool is_asked, double moved_mm) {
        SimulatedRun run = demo_run();
        run.look_for_causes = true;
        QualificationInput input = input_of(run, 3);
        for (VisitedPose& pose : input.poses) {
            Rigid shown = run.camera_from_base * pose.base_from_carriage * run.carriage_from_marker;
            if (pose.index == 43) {
                pose.corners = moved_by(pose.corners, {0.12, -0.09});
                shown.translation += moved_mm * Eigen::Vector3d(0.8, -0.6, 0.0);
            }
            if (is_asked) {
                pose.seen_at = shown;
                pose.detector_bias_px.assign(4, Eigen::Vector2d::Zero());
            }
        }
        const Causes causes = qualify(input).causes.value();
        return causes.named() ? causes.named()->text() : "";
    };
    const Rigid at = demo_run().camera_from_base *
                     input_of(demo_run(), 3).poses[43].base_from_carriage *
                     demo_run().carriage_from_marker;
    EXPECT_EQ(named(false, 0.0), "pose 43 does not fit");
    EXPECT_EQ(named(true, 0.0), "");
    EXPECT_EQ(named(true, 0.15 / 431.0 * at.translation.z()), "pose 43 does not fit");
}

TEST(Causes, NameRandomErrorsBesideThoseThatFollowARule) {
    SimulatedRun run = demo_run();
    run.true_camera.distortion.k1 *= 1.03;
    run.misread = [](std::vector<double>& q, std::size_t i) {
        q[0] += 0.02 * RandomStream(5, 6, i).normal();
    };
    const Cause cause = named_in(causes_of(run, 8));
    ASSERT_EQ(cause.errors.size(), 2u);
    EXPECT_EQ(cause.errors[0].names.front(), "scatter of x");
    EXPECT_THAT(cause.errors[1].names, Contains("k1"));
}

TEST(Causes, SayNoneOfTheseWhereItIsNone) {
    SimulatedRun run = demo_run();
    run.moved = [](Rigid at, std::size_t) {
        at.translation.z() += 3.0 * at.translation.x() * at.translation.y() / 9600.0;
        return at;
    };
    const Causes causes = causes_of(run, 9);
    EXPECT_EQ(causes.named(), nullptr);
    EXPECT_GT(causes.none_of_these, 0.9);
}

// Half a per mille is declared: 0.6 blames nobody, though it is seen where 20 ppm are declared.
TEST(Causes, BlameNobodyForWhatIsDeclared) {
    SimulatedRun run = demo_run();
    for (Axis& axis : run.axes)
        axis.scale_uncertainty = 5e-4;
    run.true_scale[1] = 1.0006;
    EXPECT_EQ(causes_of(run, 10).named(), nullptr);
    for (Axis& axis : run.axes)
        axis.scale_uncertainty = 2e-5;
    EXPECT_EQ(named_in(causes_of(run, 10)).text(), "stage scale y");
}

TEST(Causes, RefuseWhatDoesNotAgree) {
    const SimulatedRun run = demo_run();
    const Projector projector(run.camera);
    SignatureChain chain{
        projector, run.points_mm, run.camera_from_base, run.carriage_from_marker, {}};
    EXPECT_THROW(find_causes({{chain, {}, {}, {}}, {}, {}, {}}), NumericalError);
    chain.poses.resize(5);
    for (const auto& [corner, variance] : {std::pair(0.0, 0.0), {NAN, 1.0}})
        EXPECT_THROW(
            find_causes(
                {{chain, {}, {}, {}},
                 std::vector<Eigen::VectorXd>(5, Eigen::VectorXd::Constant(8, corner)),
                 std::vector<Eigen::MatrixXd>(5, variance * Eigen::MatrixXd::Identity(8, 8)),
                 {}}),
            NumericalError);
}

// What the photographs tell of focus and tone; corners that tell nothing.
ImageAgreement told(double inverse_focus, double tone, double shrink) {
    ImageAgreement match;
    match.photos = 40;
    match.evidence.errors = {"focus distance", "tone curve", "edge shrink"};
    match.evidence.observed = Eigen::Vector3d(inverse_focus, tone, shrink);
    match.evidence.covariance = Eigen::Vector3d(1e-10, 1e-6, 1e-5).asDiagonal();
    return match;
}

Causes causes_with(SimulatedRun run, std::uint64_t seed, const ImageAgreement& pixels) {
    run.look_for_causes = true;
    QualificationInput input = input_of(run, seed);
    input.pixels = pixels;
    return *qualify(input).causes;
}

TEST(Causes, NameAFocusThatOnlyPixelsShow) {
    const Cause cause = named_in(causes_with(demo_run(), 21, told(3e-4, 0.0005, -0.002)));
    EXPECT_EQ(cause.text(), "focus distance");
    EXPECT_NEAR(cause.errors.front().size, 3e-4, 2e-5);
    EXPECT_EQ(cause.errors.front().unit, "1/mm");
    EXPECT_EQ(causes_with(demo_run(), 21, told(1e-5, 0.0005, -0.002)).named(), nullptr);
}

// Edges that are seen narrower by 0.05 px in the corners: the pixels say whether the tone or the
// print is to blame.
TEST(Causes, TellAToneFromEdgesThatAreNarrower) {
    constexpr double shrunk_px = 0.05;
    SimulatedRun run = demo_run();
    run.seen = [](const Corners& corners) { return edges_moved_inwards(corners, shrunk_px); };
    EXPECT_EQ(named_in(causes_with(run, 22, told(0.0, 0.0, shrunk_px))).text(), "edge shrink");
    // The camera of this run has no lens section: a blur of 0.5 px is taken.
    const double tone = shrunk_px * std::sqrt(std::numbers::pi) / 0.5;
    const Cause light = named_in(causes_with(run, 22, told(0.0, tone, 0.0)));
    EXPECT_EQ(light.text(), "tone curve");
    EXPECT_NEAR(light.errors.front().size, tone, 0.01);
}

// ---- error signatures

struct Study {
    SimulatedRun run = demo_run();
    Projector projector{run.camera};
    std::vector<ErrorSignature> signatures;
    std::vector<StageError> stage_errors;

    Study() {
        const auto all = positions(run, run.plan_seed.value());
        SignatureChain chain{
            projector, run.points_mm, run.camera_from_base, run.carriage_from_marker, {}};
        for (std::size_t i = 0; i < all.size(); ++i) {
            chain.poses.emplace_back().hold_out = static_cast<int>(i) >= run.training;
            chain.poses.back().base_from_carriage = base_from_carriage(run.axes, all[i]);
        }
        for (std::size_t k = 0; k < 3; ++k)
            stage_errors.push_back(scale_term(run, all, k).error);
        const auto count = static_cast<std::size_t>(run.hold_out);
        const HoldOutNoise noise{std::vector<double>(count, 0.08),
                                 std::vector<double>(count, 0.007)};
        signatures = error_signatures(chain, stage_errors, noise, 0.1);
    }

    const ErrorSignature& of(const std::string& name) const {
        return *std::ranges::find(signatures, name, &ErrorSignature::name);
    }
};

TEST(ErrorSignatures, ConfoundFocalLengthWithTheScaleOfTheDepthAxis) {
    const Study study;
    EXPECT_THAT(study.of("focal length").confounded_with, Contains("stage scale z"));
    EXPECT_THAT(study.of("stage scale z").confounded_with, Contains("focal length"));
    EXPECT_THAT(study.of("focal length").confounded_with, Not(Contains("stage scale x")));
    EXPECT_TRUE(study.of("focal length").observable);
}

// A larger marker and a stage that moves less look the same: both scale the whole scene.
TEST(ErrorSignatures, ConfoundPrintSizeWithTheScaleOfAllAxesExactly) {
    const Study study;
    const Eigen::VectorXd& print = study.of("marker print size").after;
    const Eigen::VectorXd& scale = study.of("stage scale, all linear axes").after;
    EXPECT_LT((print + scale).norm(), 1e-3 * print.norm());
}

TEST(ErrorSignatures, FindAConstantOffsetNotObservable) {
    const Study study;
    const ErrorSignature& offset = study.of("constant pose offset");
    EXPECT_NEAR(offset.before_rms_mm, 0.1, 1e-6);
    EXPECT_LT(offset.after_rms_mm, 1e-8);
    EXPECT_FALSE(offset.observable);
}

TEST(ErrorSignatures, SeeMostOfThePrincipalPointAbsorbed) {
    const Study study;
    for (const char* name : {"c_x", "c_y", "half pixel"})
        EXPECT_LT(study.of(name).after_rms_mm, 0.15 * study.of(name).before_rms_mm) << name;
}

// The whole chain without noise, not linearised, against the signature: 0.2 % in focal length is
// second order to 1 %.
TEST(ErrorSignatures, AgreeWithTheWholeChain) {
    Study study;
    SimulatedRun run = without_noise(study.run);
    run.true_camera.intrinsics.zoom(1.002);
    const Qualification result = qualify(input_of(run, 3));
    const ErrorSignature& expected = study.of("focal length");
    Eigen::Index k = 0;
    double difference2 = 0.0, power = 0.0;
    for (const AnalysedPose& pose : result.poses)
        if (pose.hold_out) {
            const Eigen::Vector3d signature =
                2e-3 / expected.size * expected.after.segment<3>(3 * k++);
            difference2 += (pose.bias.b3->translation_mm - signature).squaredNorm();
            power += signature.squaredNorm();
        }
    EXPECT_LT(std::sqrt(difference2 / power), 0.1);
}

// ---- outlier poses

// Truth: fields and runs with poses that were put elsewhere.

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
