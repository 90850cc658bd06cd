// What a verdict needs beside the two figures of the field: photometric poses, lengths, the rest,
// unknown inputs and the conditions of a PASS.
#include "compare/make_detector.h"
#include "compare/photometric/photometric_detector.h"
#include "compare/qualification/judged_quantities.h"
#include "tests/compare/qualification/cancelling_errors.h"
#include "tests/test.h"

namespace etalon {
namespace {

using State = AcceptanceCondition::State;

const JudgedQuantity& quantity_named(const Qualification& result, const std::string& name) {
    for (const auto* list : {&result.quantities, &result.reported})
        for (const JudgedQuantity& each : *list)
            if (each.name == name)
                return each;
    throw NumericalError("no quantity " + name);
}

// Reads the pose from true corners, makes it wrong and draws the corners there.
std::function<Corners(const Corners&)> detector_that_reads(
    const SimulatedRun& run, const std::function<void(Eigen::Vector3d&)>& wrong) {
    return [&run, wrong](const Corners& corners) {
        Rigid pose =
            estimate_pose(Projector(run.camera), run.points_mm, corners).value().camera_from_marker;
        wrong(pose.translation);
        return corners_at(Projector(run.camera), run.points_mm, pose);
    };
}

// A perfect camera behind a detector that is wrong on purpose: by 10 mm of depth, 2 % of depth,
// half a pixel. B1 shows it; B3 and B4 stay within their U.
TEST(BiasedDetector, LeavesNoTraceInB3NorB4) {
    SimulatedRun run = demo_run();
    run.limits.by_quantity[quantity::photometric_rms] = 0.16;
    run.limits.by_quantity[quantity::photometric_max] = 0.45;
    const std::function<Corners(const Corners&)> detectors[] = {
        detector_that_reads(run, [](Eigen::Vector3d& t) { t.z() += 10.0; }),
        detector_that_reads(run, [](Eigen::Vector3d& t) { t.z() *= 1.02; }),
        [](const Corners& corners) {
            return moved_by(corners, {0.5, 0.5});
        }};
    const double least_b1_mm[] = {9.9, 5.0, 0.2};  // 2 % of 300 mm and more; half a pixel at 300 mm
    for (int i = 0; i < 3; ++i) {
        run.detector = detectors[i];
        const Qualification result = qualify(input_of(run, 1));
        EXPECT_EQ(result.verdict, Outcome::pass) << i;
        ASSERT_EQ(result.quantities.size(), 4u);
        for (const JudgedQuantity& each : result.quantities)
            EXPECT_LT(each.value, each.expanded_uncertainty) << i << " " << each.name;
        for (const AnalysedPose& pose : result.poses)
            if (pose.hold_out) {
                EXPECT_GT(pose.bias.b1->translation_mm.norm(), least_b1_mm[i]) << i;
            }
    }
}

// The readings stay where the stage's poses are while the stage is told a wrong scale: 1 % of z
// puts 0.01 x 87 mm RMS of depth (the standard deviation of +-150 mm) into both fields, less what
// registration takes.
TEST(PhotometricField, IsJudgedBesideB3) {
    SimulatedRun run = demo_run();
    run.true_scale[2] = 1.01;
    run.limits.by_quantity[quantity::photometric_rms] = 0.16;
    const Qualification result = qualify(input_of(run, 1));
    EXPECT_EQ(quantity_named(result, quantity::photometric_rms).outcome, Outcome::fail);
    EXPECT_NEAR(quantity_named(result, quantity::photometric_rms).value, 0.87, 0.2);
    EXPECT_FALSE(quantity_named(result, quantity::photometric_max).limit > 0.0);  // reported
    EXPECT_TRUE(quantity_named(result, quantity::photometric_max).measured);
}

TEST(PhotometricField, IsSkippedWithoutPhotometricPoses) {
    SimulatedRun run = demo_run();
    run.limits.by_quantity[quantity::photometric_rms] = 0.16;
    QualificationInput input = input_of(run, 1);
    for (VisitedPose& pose : input.poses)
        pose.photometric.reset();
    const Qualification result = qualify(input);
    EXPECT_EQ(result.verdict, Outcome::inconclusive);
    EXPECT_EQ(quantity_named(result, quantity::photometric_rms).outcome, Outcome::skipped);
    EXPECT_THAT(result.reasons, Contains(HasSubstr("photometric")));
}

TEST(Rest, IsSkippedWhereTheNoiseIsNotKnown) {
    SimulatedRun run = demo_run();
    run.limits.by_quantity[quantity::lack_of_fit_rms] = 0.2;
    QualificationInput input = input_of(run, 1);
    EXPECT_EQ(qualify(input).verdict, Outcome::pass);
    for (VisitedPose& pose : input.poses)
        pose.corner_noise.reset();
    const Qualification result = qualify(input);
    EXPECT_EQ(quantity_named(result, quantity::lack_of_fit_rms).outcome, Outcome::skipped);
    EXPECT_EQ(result.verdict, Outcome::inconclusive);
    EXPECT_EQ(condition(result, "residuals against noise").state, State::not_checked);
}

// 5 K and 25 ppm/K of the marker's size cannot bring the demo to its limits; a marker that is bent
// by a hundredth of its size can.
TEST(UnknownInputs, WithholdPassOnlyWhereTheyCouldMatter) {
    QualificationInput input = demo_input();
    input.temperature.reset();
    const Qualification without_temperature = qualify(input);
    EXPECT_EQ(without_temperature.verdict, Outcome::pass);
    EXPECT_TRUE(without_temperature.budget_complete);
    input.marker_flatness_mm.reset();
    const Qualification without_both = qualify(input);
    EXPECT_EQ(without_both.verdict, Outcome::inconclusive);
    EXPECT_THAT(without_both.reasons, Contains(HasSubstr("'marker twist'")));
}

// Of one material marker and stage grow alike and the pictures stay the same.
TEST(Temperature, HasNoEffectWhereMarkerAndStageExpandAlike) {
    QualificationInput input = demo_input();
    const auto contribution = [&](double marker, double stage) {
        input.temperature = DeclaredTemperature{2.0, marker, stage};
        const Qualification result = qualify(input);
        return std::ranges::find(result.budget, "temperature", &BudgetRow::source)
            ->contribution(quantity::position_rms);
    };
    const double marker_alone = contribution(20e-6, 0.0);
    EXPECT_GT(marker_alone, 0.01);
    EXPECT_LT(contribution(20e-6, 20e-6), 0.01 * marker_alone);
    EXPECT_NEAR(contribution(0.0, 20e-6), marker_alone, 0.01 * marker_alone);
}

// fx and fy off together by 0.4 px of 431 are one error of the focal length, 0.4 / 431 of it.
TEST(CalibrationCovariance, IsShownAndNotCounted) {
    SimulatedRun run = demo_run();
    const Qualification without = qualify(input_of(run, 1));
    run.camera.covariance = ParameterCovariance{{"fx", "fy"}, Eigen::Matrix2d::Constant(0.4 * 0.4)};
    const Qualification with = qualify(input_of(run, 1));
    const auto row = std::ranges::find(with.budget, "calibration covariance", &BudgetRow::source);
    EXPECT_FALSE(row->counted);
    const auto focal = std::ranges::find(with.signatures, "focal length", &ErrorSignature::name);
    const double expected = 0.4 / 431.0 / focal->size * focal->after_rms_mm;
    EXPECT_NEAR(row->contribution(quantity::position_rms) / expected, 1.0, 1e-3);
    EXPECT_EQ(with.quantities[0].expanded_uncertainty, without.quantities[0].expanded_uncertainty);
}

TEST(MonteCarlo, StaysBelowTheSimultaneousBandsAndNearThem) {
    QualificationInput input = demo_input();
    input.options.monte_carlo = true;
    const Qualification result = qualify(input);
    for (const char* name :
         {quantity::position_rms, quantity::position_max, quantity::length_max}) {
        const JudgedQuantity& each = quantity_named(result, name);
        ASSERT_TRUE(each.monte_carlo_uncertainty) << name;
        EXPECT_LT(*each.monte_carlo_uncertainty, 1.05 * each.expanded_uncertainty) << name;
        EXPECT_GT(*each.monte_carlo_uncertainty, 0.4 * each.expanded_uncertainty) << name;
    }
}

TEST(Conditions, AreMetByAPerfectRun) {
    const Qualification result = qualify(demo_input());
    EXPECT_EQ(result.verdict, Outcome::pass);
    const std::set<std::string> not_asked = {"repeatability", "rest within poses"};
    for (const AcceptanceCondition& each : result.conditions)
        EXPECT_EQ(each.state, not_asked.contains(each.name) ? State::not_asked : State::met)
            << each.name;
}

// The hold-out poses of one corner of the volume are not seen.
TEST(Conditions, WithholdPassWhenACornerOfTheVolumeWasNotSeen) {
    const SimulatedRun run = demo_run();
    QualificationInput input = input_of(run, 1);
    const auto all = positions(run, *run.plan_seed);
    int lost = 0;
    for (std::size_t i = 0; i < all.size(); ++i)
        if (input.poses[i].hold_out && all[i][0] > 0 && all[i][1] > 0 && all[i][2] > 0) {
            input.poses[i].corners.clear();
            ++lost;
        }
    ASSERT_GT(lost, 1);
    const Qualification result = qualify(input);
    EXPECT_EQ(condition(result, "volume coverage").state, State::not_met);
    EXPECT_EQ(result.verdict, Outcome::inconclusive);
    EXPECT_THAT(result.reasons, Contains(HasSubstr("volume coverage")));
}

// Corners scatter three times as far as repeated frames say.
TEST(Conditions, WithholdPassWhenTheResidualsAreLargerThanTheStatedNoise) {
    QualificationInput input = demo_input();
    for (VisitedPose& pose : input.poses)
        pose.corner_noise->variance_px2 /= 9.0;
    for (DeclaredRepeatability& each : input.repeatability)
        each.marker_mm = 0.0;  // so that the corners' noise is all that is stated
    const Qualification result = qualify(input);
    const AcceptanceCondition& found = condition(result, "residuals against noise");
    EXPECT_EQ(found.state, State::not_met);
    EXPECT_NEAR(found.value, 9.0, 4.5);  // 3.3 of its deviations, 9 sqrt(2 / 87)
    EXPECT_EQ(result.verdict, Outcome::inconclusive);
}

// A scale of each axis is 1000 ppm off. Declared as that uncertain it is one of the errors that U
// holds; declared as known to 20 ppm it is more than what is stated.
TEST(Conditions, JudgeResidualsAgainstWhatIsDeclared) {
    int shown = 0;
    for (std::size_t axis = 0; axis < 4; ++axis)
        for (const double declared : {1e-3, 20e-6}) {
            SimulatedRun run = demo_run();
            run.true_scale[axis] = 1.001;
            run.axes[axis].scale_uncertainty = declared;
            const Qualification result = qualify(input_of(run, 1));
            const AcceptanceCondition& found = condition(result, "residuals against noise");
            if (declared == 1e-3)
                EXPECT_EQ(found.state, State::met) << run.axes[axis].name << " " << found.text;
            else
                shown += found.state == State::not_met ? 1 : 0;
        }
    EXPECT_GT(shown, 0);
}

// The camera slides by 0.5 mm across the line of sight while the hold-out poses are taken.
TEST(Conditions, WithholdPassWhenTheRunDrifts) {
    SimulatedRun run = demo_run();
    QualificationInput input = input_of(run, 1);
    const auto all = positions(run, *run.plan_seed);
    for (int i = 0; i < run.hold_out; ++i) {
        const auto pose = static_cast<std::size_t>(run.training + i);
        SimulatedRun slid = run;
        slid.camera_from_base.translation.x() += 0.5 * (i / (run.hold_out - 1.0) - 0.5);
        input.poses[pose].corners = photo(slid, all[pose], 1, pose);
    }
    const Qualification result = qualify(input);
    const AcceptanceCondition& found = condition(result, "drift over the run");
    EXPECT_EQ(found.state, State::not_met);
    EXPECT_NEAR(found.value, 0.5, 0.1);
    EXPECT_NE(result.verdict, Outcome::pass);
}

// The run rests for ten hours after 20 hold-out poses; then the camera stands 0.4 mm aside, and
// otherwise it slides by as much while poses are taken. A line over the whole time shows neither.
TEST(Conditions, SeeADriftBesideAPause) {
    const SimulatedRun run = demo_run();
    const auto all = positions(run, *run.plan_seed);
    constexpr double pause_s = 36'000.0;
    for (const bool slides : {false, true}) {
        QualificationInput input = input_of(run, 1);
        for (std::size_t pose = 0; pose < input.poses.size(); ++pose) {
            const bool later = pose >= static_cast<std::size_t>(run.training) + 20;
            SimulatedRun moved = run;
            moved.camera_from_base.translation.x() +=
                slides ? 0.5 * (static_cast<double>(pose) / 69.0 - 0.5) : (later ? 0.4 : 0.0);
            input.poses[pose].corners = photo(moved, all[pose], 1, pose);
            *input.poses[pose].settled_s += later ? pause_s : 0.0;
        }
        const AcceptanceCondition found = condition(qualify(input), "drift over the run");
        EXPECT_EQ(found.state, State::not_met) << found.text;
        EXPECT_THAT(found.text, HasSubstr("a pause of 36002 s"));
    }
}

// Readings of x that scatter by 0.24 mm within every pose, though no pose is off.
TEST(Conditions, WithholdPassWhereTheStageDoesNotRest) {
    QualificationInput input = demo_input();
    const auto with_readings = [&](double scatter_mm) {
        for (VisitedPose& pose : input.poses) {
            pose.readings.assign(4, {});
            pose.read_back_deviation = {scatter_mm, 0.0, 0.0, 0.0};
        }
        return condition(qualify(input), "rest within poses");
    };
    EXPECT_EQ(condition(qualify(input), "rest within poses").state, State::not_asked);
    EXPECT_EQ(with_readings(0.03).state, State::met);
    const AcceptanceCondition found = with_readings(0.24);
    EXPECT_EQ(found.state, State::not_met);
    EXPECT_NEAR(found.value, 0.24, 1e-9);
    EXPECT_NE(qualify(input).verdict, Outcome::pass);
    input.repeatability[0].reading_mm = 0.25;
    EXPECT_EQ(with_readings(0.24).state, State::met);
}

// Without times drift cannot be told, and no PASS rests on that unless the limits say so.
TEST(Conditions, WithholdPassWhereTheyCannotBeChecked) {
    QualificationInput input = demo_input();
    input.poses[50].settled_s.reset();
    const Qualification result = qualify(input);
    EXPECT_EQ(condition(result, "drift over the run").state, State::not_checked);
    EXPECT_EQ(result.verdict, Outcome::inconclusive);
    EXPECT_THAT(result.reasons, Contains(HasSubstr("drift over the run could not be checked")));
    input.limits.may_be_unchecked = {"repeatability"};
    EXPECT_EQ(qualify(input).verdict, Outcome::inconclusive);
    input.limits.may_be_unchecked = {"drift over the run"};
    EXPECT_EQ(qualify(input).verdict, Outcome::pass);
}

// Training poses 1 to 6 are visited again as 7 to 12, where the stage has settled elsewhere by
// 0.3 mm.
TEST(Conditions, CheckPosesThatAreVisitedAgain) {
    for (const double settled_mm : {0.0, 0.3}) {
        SimulatedRun run = demo_run();
        QualificationInput input = input_of(run, 1);
        auto all = positions(run, *run.plan_seed);
        for (std::size_t i = 7; i <= 12; ++i) {
            SimulatedRun settled = run;
            settled.camera_from_base.translation.y() += settled_mm;
            input.poses[i].base_from_carriage = input.poses[i - 6].base_from_carriage;
            input.poses[i].corners = photo(settled, all[i - 6], 1, i);
            input.poses[i].repeats = i - 6;
        }
        input.stage_terms.clear();  // they are of the other positions
        for (std::size_t i = 7; i <= 12; ++i)
            all[i] = all[i - 6];
        for (std::size_t k = 0; k < run.axes.size(); ++k)
            input.stage_terms.push_back(scale_term(run, all, k));
        const Qualification result = qualify(input);
        EXPECT_EQ(condition(result, "repeatability").state,
                  settled_mm > 0.0 ? State::not_met : State::met)
            << condition(result, "repeatability").text;
    }
}

constexpr double background = 0.6, white_level = 0.8;

CameraModel rec709_camera(const CameraModel& geometry) {
    CameraModel camera = geometry;
    camera.lens = Lens{1.4, 1200.0, 550.0, {}};
    camera.sensor = Sensor{.pixel_pitch_um = 5.0,
                           .transfer = {Transfer::Kind::rec709, {}},
                           .black_dn = 8,
                           .gain_e_per_dn = 60,
                           .read_noise_e = 10};
    return camera;
}

// Of a coordinate in one exposure, from six.
CornerNoise noise_of_exposures(
    const std::function<std::optional<DetectedCorners>(std::uint32_t frame)>& corners_in,
    std::uint32_t first) {
    constexpr std::uint32_t exposures = 6;
    Eigen::MatrixXd seen(8, exposures);
    for (std::uint32_t i = 0; i < exposures; ++i) {
        const Corners corners = corners_in(first + i).value().pixels;
        seen.col(i) = Eigen::Map<const Eigen::VectorXd>(corners.front().data(), 8);
    }
    const double freedom = 8.0 * (exposures - 1.0);
    return {(seen.colwise() - seen.rowwise().mean()).squaredNorm() / freedom, freedom};
}

// A perfect camera whose codes follow Rec. 709, through pixels: photographs with noise, AprilTag on
// photographs and renders, and photometric poses. The curve moves the detector's edges: B1 has it,
// B3 has not, and B4 takes it between the photograph's own levels.
TEST(Rec709, DoesNotKeepAPerfectCameraFromPassing) {
    SimulatedRun run = demo_run();
    run.camera = run.true_camera = rec709_camera(run.camera);
    run.training = 20;
    run.hold_out = 20;
    run.limits.by_quantity[quantity::photometric_rms] = 0.16;
    run.limits.by_quantity[quantity::photometric_max] = 0.45;
    const Marker marker = parse_marker("apriltag:36h11:5@80mm", "test");
    const Renderer renderer(run.camera);
    const SensorModel sensor(run.camera);
    const auto detector = make_detector("auto", marker, "test");
    const PhotometricDetector photometric(run.camera, marker, "test");
    const auto radiance = [&](const Rigid& pose) {
        return Radiance(renderer.render({{{marker.grid, pose}}, background}).radiance *
                        white_level);
    };

    QualificationInput input = input_of(run, 1);
    input.render_and_detect = [&](const Rigid& pose) -> std::optional<Corners> {
        const auto found = detector->detect(sensor.expose(radiance(pose))).corners;
        return found ? std::optional(found->pixels) : std::nullopt;
    };
    const auto all = positions(run, *run.plan_seed);
    for (std::size_t i = 0; i < all.size(); ++i) {
        RandomStream stage_noise(1, 100, i);
        const Rigid truth = true_pose(run, all[i], stage_noise, i);
        const CodeImage photo =
            sensor.expose(radiance(truth), NoiseKey{1, static_cast<std::uint32_t>(i)});
        const auto found = detector->detect(photo).corners;
        ASSERT_TRUE(found) << i;
        VisitedPose& pose = input.poses[i];
        pose.corners = found->pixels;
        pose.corner_noise.reset();
        if (i % 4 == 0)
            pose.stated_noise = noise_of_exposures(
                [&](std::uint32_t frame) {
                    return detector->detect(sensor.expose(radiance(truth), NoiseKey{2, frame}))
                        .corners;
                },
                static_cast<std::uint32_t>(100 * i));
        pose.photometric.reset();
        if (!pose.hold_out)
            continue;
        const auto start =
            estimate_pose(photometric.camera()->projector(), marker.points_mm, found->pixels);
        const PhotometricPose reading = photometric.find(photo, start->camera_from_marker, 0.5);
        pose.photometric = PhotometricReading{reading.camera_from_marker, reading.covariance};
    }
    const Qualification result = qualify(input);
    EXPECT_EQ(result.verdict, Outcome::pass);
    for (const JudgedQuantity& each : result.quantities) {
        EXPECT_EQ(each.outcome, Outcome::pass) << each.name;
        EXPECT_LT(each.value, each.expanded_uncertainty) << each.name;
    }
    double b1_mm = 0.0;
    for (const AnalysedPose& pose : result.poses)
        if (pose.hold_out && pose.bias.b1)
            b1_mm = std::max(b1_mm, pose.bias.b1->translation_mm.norm());
    EXPECT_GT(b1_mm, 3.0);  // 0.05 mm is left of it
}

// ---- qualification

// How often the verdict is right, over seeds of the noise, with the demo's plan. 100 runs: a case
// that must come out in 99 % of runs does so at least 96 times in all but 0.4 % of such tests
// (binomial).

constexpr int runs = 100;

int count(const std::function<void(SimulatedRun&)>& change, Outcome outcome) {
    SimulatedRun run = demo_run();
    change(run);
    int found = 0;
    for (std::uint64_t seed = 1; seed <= runs; ++seed)
        found += qualify(input_of(run, seed)).verdict == outcome ? 1 : 0;
    return found;
}

TEST(QualificationStatistics, PerfectCamerasPass) {
    EXPECT_GE(count([](SimulatedRun&) {}, Outcome::pass), 96);
}

TEST(QualificationStatistics, FocalLengthsOffByHalfAPercentFail) {
    const auto shorter = [](SimulatedRun& run) { run.true_camera.intrinsics.zoom(0.995); };
    EXPECT_GE(count(shorter, Outcome::fail), 96);
}

TEST(QualificationStatistics, DistortionsOffByTenPercentFail) {
    const auto flatter = [](SimulatedRun& run) { run.true_camera.distortion.k1 *= 0.9; };
    EXPECT_GE(count(flatter, Outcome::fail), 96);
}

TEST(QualificationStatistics, StagesWithTheScaleOfDepthOrHeightOffNeverPass) {
    for (const auto& [axis, scale] : {std::pair(2, 1.002), std::pair(1, 0.998)}) {
        const auto stretched = [axis = axis, scale = scale](SimulatedRun& run) {
            run.true_scale.at(axis) = scale;
        };
        EXPECT_EQ(count(stretched, Outcome::pass), 0) << axis;
    }
}

// Errors that cancel in the judged field, drawn as tests/evidence/cancelling_errors.cpp draws 2000
// of them. Of runs that pass by their field alone in a good part none may pass: were it 1 in 30,
// none of 100 would show it in 3 % of such tests.
TEST(CancellingErrorsStatistics, DoNotPass) {
    const KnownRun known;
    const CancellingErrors errors;
    int by_field = 0;
    for (std::uint64_t n = 0; n < runs; ++n) {
        RandomStream random(7, 300, n);
        const auto which =
            static_cast<std::size_t>(random.uniform() * static_cast<double>(errors.sets().size()));
        const CancellingSet& set = errors.sets()[which];
        const double times = 1.0 + 2.0 * random.uniform();
        const Qualification result = known.judged(errors.run(set, times), 7 + n);
        EXPECT_NE(result.verdict, Outcome::pass) << errors.name(set) << " at " << times;
        by_field += combine(result.quantities) == Outcome::pass ? 1 : 0;
    }
    EXPECT_GT(by_field, 10);
}

// Where everything is off as it is declared, 1 % of passes may be lost to the conditions that are
// not on the field: more than 4 of 100 come in 0.3 % of such tests.
TEST(CancellingErrorsStatistics, HonestRunsKeepTheirPasses) {
    const KnownRun known;
    int by_field = 0, passed = 0;
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
        const Qualification result = known.judged(honest_run(seed), seed);
        by_field += passes_by_field_alone(result) ? 1 : 0;
        passed += result.verdict == Outcome::pass ? 1 : 0;
    }
    EXPECT_GE(by_field, 96);
    EXPECT_GE(passed, by_field - 4);
}

}  // namespace
}  // namespace etalon
