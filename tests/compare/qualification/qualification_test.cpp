#include "compare/qualification/qualification.h"

#include "compare/qualification/judged_quantities.h"
#include "core/config/strict_reader.h"
#include "core/geometry/units.h"
#include "tests/compare/qualification/injected_errors.h"
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
    run.limits.by_quantity[quantity::rotation_rms] = 2.0;
    run.limits.by_quantity[quantity::rotation_max] = 6.0;
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
    const auto blur = std::ranges::find(result.reported, "pixel_blur_px", &JudgedQuantity::name);
    ASSERT_NE(blur, result.reported.end());
    EXPECT_EQ(blur->value, 0.21);
    EXPECT_EQ(blur->expanded_uncertainty, 0.03);
    EXPECT_EQ(blur->coverage_factor, 3.0);
    const auto tone = std::ranges::find(result.reported, "pixel_tone_gray", &JudgedQuantity::name);
    EXPECT_FALSE(tone->measured);
}

TEST(Qualification, JudgesPixelsByTheirLimits) {
    for (const auto& [limit, expected] :
         {std::pair(0.30, Outcome::pass), std::pair(0.22, Outcome::inconclusive),
          std::pair(0.10, Outcome::fail)}) {
        QualificationInput input = demo_input();
        input.limits.by_quantity["pixel_blur_px"] = limit;
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

// ---- wide qualification

// A run before a wide lens, at corner level: as declared it passes, an error fails it and is named.

Qualification qualified_wide(SimulatedRun run, std::uint64_t seed = 1) {
    run.look_for_causes = true;
    return qualify(input_of(run, seed));
}

std::vector<std::string> best_names(const Qualification& result) {
    const Cause* cause = result.causes ? result.causes->named() : nullptr;
    return cause && cause->errors.size() == 1 ? cause->errors.front().names
                                              : std::vector<std::string>{};
}

// Angles to the axis of the marker's places, deg: the least and the largest.
std::pair<double, double> angles_deg(const std::vector<AnalysedPose>& poses) {
    std::pair<double, double> ends{180.0, 0.0};
    for (const AnalysedPose& pose : poses) {
        const double angle =
            std::acos(pose.bias.predicted.translation.normalized().z()) * deg_per_rad;
        ends = {std::min(ends.first, angle), std::max(ends.second, angle)};
    }
    return ends;
}

TEST(WideQualification, PassesALensThatIsAsDeclaredBeyondNinetyDegreesToo) {
    for (const double aside : {0.67, 1.35}) {
        const SimulatedRun run = wide_run(aside);
        const Qualification result = qualify(input_of(run, 1));
        EXPECT_EQ(result.verdict, Outcome::pass);
        EXPECT_THAT(result.reasons, IsEmpty());
        const auto [least, largest] = angles_deg(result.poses);
        EXPECT_LT(least, aside < 1.0 ? 25.0 : 62.0);
        EXPECT_GT(largest, aside < 1.0 ? 60.0 : 90.0);
    }
}

// Far aside the image is stretched unlike in two directions, and no field of positions follows the
// error: no PASS. Elsewhere it is a FAIL.
TEST(WideQualification, FailsAWrongLensAndNamesIt) {
    for (const bool is_far_aside : {true, false}) {
        SimulatedRun run = wide_run(is_far_aside ? 1.35 : 0.67);
        run.true_camera.intrinsics.zoom(1.005);
        const Qualification result = qualified_wide(run);
        EXPECT_NE(result.verdict, Outcome::pass);
        EXPECT_TRUE(is_far_aside || result.verdict == Outcome::fail);
        EXPECT_THAT(best_names(result), Contains("focal length"));
    }
    SimulatedRun run = wide_run();
    run.true_camera.distortion.k1 *= 1.1;
    const Qualification result = qualified_wide(run);
    EXPECT_EQ(result.verdict, Outcome::fail);
    EXPECT_THAT(best_names(result), Contains("k1"));
}

TEST(WideQualification, FindsTheParametersOfItsProjection) {
    SimulatedRun run = wide_run();
    run.camera.projection = {Projection::double_sphere, -0.17, 0.59};
    run.camera.intrinsics.fx = run.camera.intrinsics.fy = 195.0;
    run.camera.distortion = {};
    run.true_camera = run.camera;
    EXPECT_EQ(qualified_wide(run).verdict, Outcome::pass);
    run.true_camera.projection.b += 0.004;
    const Qualification result = qualified_wide(run);
    EXPECT_EQ(result.verdict, Outcome::fail);
    EXPECT_THAT(best_names(result), Contains("alpha"));
}

std::vector<std::string> names(const std::vector<CameraError>& errors) {
    std::vector<std::string> all;
    for (const CameraError& error : errors)
        all.push_back(error.name);
    return all;
}

TEST(WideQualification, LooksForErrorsThatTheLensCanHave) {
    CameraModel camera = demo_run().camera;
    EXPECT_THAT(names(named_camera_errors(camera)), Not(Contains("k7")));
    EXPECT_THAT(names(further_camera_errors(camera)), Contains("sensor tilt tau_x"));
    camera.projection = {Projection::unified, 1.31};
    EXPECT_THAT(names(named_camera_errors(camera)), testing::IsSupersetOf({"k7", "xi"}));
    EXPECT_THAT(names(further_camera_errors(camera)), Each(Not(HasSubstr("tilt"))));
    // At the end of its range it can be off one way only.
    camera.projection = {Projection::double_sphere, 0.1, 1.0};
    EXPECT_THAT(names(named_camera_errors(camera)), Not(Contains("alpha")));
}

// At 100 degrees r^9 is 170 times what it is at 1 radian: the size must not fold the image.
TEST(WideQualification, TakesErrorsThatAreSmallAllOverTheImage) {
    const SimulatedRun run = wide_run();
    for (const CameraError& error : named_camera_errors(run.camera))
        for (const double side : {-1.0, 1.0}) {
            CameraModel off = run.camera;
            error.change(off, side * error.size);
            const Eigen::Vector3d aside(std::sin(1.75), 0.0, std::cos(1.75));
            const auto moved = Projector(off).project(aside);
            ASSERT_TRUE(moved) << error.name;
            EXPECT_LT((*moved - *Projector(run.camera).project(aside)).norm(), 1.0) << error.name;
        }
}

// ---- limits file

const std::string good =
    "etalon: limits/1\n"
    "id: demo-7\n"
    "b3_position_field_rms_mm: {limit: 0.07, unit: mm}\n"
    "b3_position_field_max_mm: {limit: 0.25, unit: mm}\n";

std::filesystem::path file_with(const std::string& text) {
    static const TemporaryFolder folder;
    const std::filesystem::path path = folder / "limits.yaml";
    write_text(path, text);
    return path;
}

std::string refusal(const std::string& text) {
    return config_error_of([&] { read_limits(file_with(text)); });
}

TEST(LimitsFile, ReadsWhatIsRequired) {
    const Limits limits = read_limits(file_with(good));
    EXPECT_EQ(limits.id, "demo-7");
    EXPECT_EQ(limits.by_quantity.at(quantity::position_rms), 0.07);
    EXPECT_EQ(limits.by_quantity.at(quantity::position_max), 0.25);
    EXPECT_FALSE(limits.pixels_must_match);
}

TEST(LimitsFile, ReadsEveryOtherLimitWhenItIsThere) {
    std::string text = good;
    double limit = 0.11;
    for (const QuantityKind& kind : quantity_kinds().subspan(2)) {
        EXPECT_FALSE(read_limits(file_with(text)).by_quantity.contains(kind.name)) << kind.name;
        text +=
            fmt::format("{}: {{limit: {}, unit: \"{}\"}}\n", kind.name, limit += 0.25, kind.unit);
        EXPECT_EQ(read_limits(file_with(text)).by_quantity.at(kind.name), limit) << kind.name;
    }
    EXPECT_EQ(read_limits(file_with(text)).by_quantity.at(quantity::rotation_rms), 0.36);
}

TEST(LimitsFile, SaysWhereAndWhatIsWrong) {
    const std::string head = "etalon: limits/1\nid: a\n";
    EXPECT_THAT(refusal(head + "b3_position_field_rms_mm: {limit: 0.07, unit: mm}\n"),
                HasSubstr("b3_position_field_max_mm"));
    EXPECT_THAT(refusal(good + "b3_positoin: {limit: 1, unit: mm}\n"),
                AllOf(HasSubstr(":5:"), HasSubstr("b3_positoin")));
    EXPECT_THAT(refusal(head + "b3_position_field_rms_mm: {limit: 0.07, unit: um}\n"),
                AllOf(HasSubstr(":3:"), HasSubstr("unit")));
    EXPECT_THAT(refusal(head + "b3_position_field_rms_mm: {limit: 0, unit: mm}\n"),
                AllOf(HasSubstr(":3:"), HasSubstr("limit")));
    EXPECT_THAT(refusal(head + "b3_position_field_rms_mm: {limit: .nan, unit: mm}\n"),
                HasSubstr(":3:"));
}

TEST(LimitsFile, RefusesAMaximumBelowItsRms) {
    const std::string head = "etalon: limits/1\nid: a\n";
    const auto position = [&](double max) {
        return refusal(head + "b3_position_field_rms_mm: {limit: 0.07, unit: mm}\n" +
                       fmt::format("b3_position_field_max_mm: {{limit: {}, unit: mm}}\n", max));
    };
    EXPECT_EQ(position(0.07), "no error");
    EXPECT_THAT(position(0.06),
                EndsWith("limits.yaml:4: b3_position_field_max_mm.limit: is 0.06, below the limit "
                         "of b3_position_field_rms_mm, 0.07: no maximum is below its RMS"));
    for (const std::string kind : {"b3_rotation_field_{}_mrad", "b4_position_field_{}_mm"}) {
        const std::string unit = kind.substr(kind.rfind('_') + 1);
        std::string text = good;
        for (const auto& [of, limit] : {std::pair("max", 1), std::pair("rms", 2)})
            text +=
                fmt::format(fmt::runtime(kind + ": {{limit: {}, unit: {}}}\n"), of, limit, unit);
        EXPECT_THAT(refusal(text), HasSubstr("limits.yaml:5: ")) << kind;
    }
}

TEST(LimitsFile, ReadsWhetherPixelsMustMatch) {
    EXPECT_TRUE(read_limits(file_with(good + "pixels: must_match\n")).pixels_must_match);
    EXPECT_THAT(refusal(good + "pixels: maybe\n"), HasSubstr("limits.yaml:5"));
}

TEST(LimitsFile, KnowsTheRangeOfEveryQuantity) {
    for (const QuantityKind& kind : quantity_kinds())
        EXPECT_TRUE(std::ranges::any_of(units::all, [&](const Unit& unit) {
            return std::string(unit.name) == kind.unit;
        })) << kind.name;
}

TEST(LimitsFile, ReadsTheDecisionRule) {
    const auto factor = [](const std::string& rule) {
        return read_limits(file_with(good + rule)).rule.guard_factor;
    };
    EXPECT_EQ(factor(""), 1.0);
    EXPECT_EQ(factor("decision_rule: guarded\n"), 1.0);
    EXPECT_EQ(factor("decision_rule: simple\n"), 0.0);
    EXPECT_EQ(factor("decision_rule: {guard_band: 0.83}\n"), 0.83);
    EXPECT_THAT(refusal(good + "decision_rule: lenient\n"), HasSubstr("decision_rule"));
    EXPECT_THAT(refusal(good + "decision_rule: {guard_band: 3.1}\n"),
                HasSubstr("decision_rule.guard_band"));
    EXPECT_THAT(refusal(good + "decision_rule: {guard_band: 1, factor: 2}\n"),
                HasSubstr("decision_rule.factor"));
}

TEST(LimitsFile, ReadsWhatMayBeUnchecked) {
    EXPECT_FALSE(read_limits(file_with(good)).lets_pass_unchecked("repeatability"));
    const Limits limits = read_limits(
        file_with(good + "may_be_unchecked: [repeatability, residuals against noise]\n"));
    EXPECT_TRUE(limits.lets_pass_unchecked("repeatability"));
    EXPECT_TRUE(limits.lets_pass_unchecked("residuals against noise"));
    EXPECT_FALSE(limits.lets_pass_unchecked("drift over the run"));
    EXPECT_THAT(refusal(good + "may_be_unchecked: [declared inputs]\n"),
                AllOf(HasSubstr(":5:"), HasSubstr("may_be_unchecked")));
}

TEST(LimitsFile, ReadsWhenACameraIsDueAndHowItsFleetScatters) {
    const std::string prior = "unit: mm, prior: {mean: 0.03, deviation: 0.01}}";
    std::string text = good + "due_after_days: 180\n";
    text.replace(text.find("unit: mm}"), 9, prior);
    const Limits limits = read_limits(file_with(text));
    EXPECT_EQ(limits.due_after_days, 180);
    ASSERT_EQ(limits.priors.size(), 1u);
    EXPECT_EQ(limits.priors.at("b3_position_field_rms_mm").mean, 0.03);
    EXPECT_EQ(limits.priors.at("b3_position_field_rms_mm").deviation, 0.01);
    EXPECT_FALSE(read_limits(file_with(good)).due_after_days);
    EXPECT_THAT(refusal(good + "due_after_days: 0\n"), HasSubstr("due_after_days"));
}

}  // namespace
}  // namespace etalon
