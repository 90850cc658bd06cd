#include "station/qualify/runner.h"

#include "compare/photo_pose.h"
#include "tests/station/station_of_mocks.h"

namespace etalon {
namespace {

using SortedJson = nlohmann::json;

class Runner : public testing::Test {
protected:
    StationOfMocks mocks;
};

TEST_F(Runner, KeepsWhatWasMeasuredAndStopsTheAxesWhenTheStageFails) {
    mocks.before_move = [](std::size_t move) {
        if (move == 3)
            throw DeviceError("stage 127.0.0.1:1599", "move", "alarm 12");
    };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::error);
    EXPECT_EQ(exit_code(result.outcome), 4);
    EXPECT_EQ(mocks.stops, 1);
    EXPECT_EQ(mocks.closings, 1);
    EXPECT_EQ(result.poses.size(), 3u);
    EXPECT_EQ(mocks.events("pose").size(), 3u);
    EXPECT_TRUE(std::filesystem::exists(mocks.folder / "record/frames/0002_1.png"));
    EXPECT_EQ(mocks.run_file()["outcome"], "ERROR");
    EXPECT_EQ(mocks.run_file()["reason"], "stage 127.0.0.1:1599: move: alarm 12");
    EXPECT_EQ(mocks.events("stage trace").at(0)["detail"], "-3 ms read registers 0..13\n");
    EXPECT_TRUE(std::filesystem::exists(mocks.folder / "record/report.html"));
}

// Each attempt costs 2 s, and the run has to end within 10 s.
TEST_F(Runner, LeavesTheLastAttemptToStopToClosingAStageThatDoesNotAnswer) {
    mocks.before_move = [&](std::size_t move) {
        mocks.stage_is_silent = move == 2;
        if (mocks.stage_is_silent)
            throw DeviceError("stage fake", "move", "no answer");
    };
    EXPECT_EQ(mocks.run().outcome, RunOutcome::error);
    EXPECT_EQ(mocks.stops, 0);
    EXPECT_EQ(mocks.closings, 1);
    EXPECT_EQ(mocks.events("axes stopped").at(0)["detail"], "NOT confirmed by the controller");
}

// Seen by the next move at any other pose; the measured poses stay, as there.
TEST_F(Runner, EndsWhenAnAxisIsPushedAfterTheLastPicture) {
    mocks.on_status = [&](std::vector<AxisStatus>& axes) {
        if (mocks.moves == 25 && mocks.events("pose").size() == 25)
            axes[1].alarm = 17;
    };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::error);
    EXPECT_THAT(result.reason, HasSubstr("read the positions: axis y: alarm 17"));
    EXPECT_EQ(result.poses.size(), 25u);
    EXPECT_EQ(mocks.stops, 1);
}

TEST_F(Runner, StopsTheAxesWhenTheCameraIsGone) {
    mocks.on_camera = [](FakeCamera& camera) { camera.triggers_left = 5; };  // 2 frames a pose
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::error);
    EXPECT_EQ(result.poses.size(), 2u);
    EXPECT_GE(mocks.stops, 1);
    EXPECT_EQ(mocks.moves, 3);
}

TEST_F(Runner, TakesUpACameraThatWasGoneForAWhile) {
    FakeCamera* camera = nullptr;
    mocks.on_camera = [&](FakeCamera& opened) { camera = &opened; };
    mocks.before_move = [&](std::size_t move) {
        if (move == 4)
            camera->lose_once();
    };
    const QualifyResult result = mocks.run();
    EXPECT_NE(result.outcome, RunOutcome::error) << result.reason;
    EXPECT_EQ(result.statistics().reconnects, 1);
    EXPECT_EQ(mocks.events("camera lost").size(), 1u);
    EXPECT_EQ(mocks.events("camera reconnected").size(), 1u);
    EXPECT_EQ(mocks.run_file()["camera"]["reconnects"], 1);
}

TEST_F(Runner, EndsAtOnceWhenStopIsRequested) {
    mocks.stop_before(4);
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::aborted);
    EXPECT_EQ(exit_code(result.outcome), 130);
    EXPECT_EQ(result.poses.size(), 4u);
    EXPECT_GE(mocks.stops, 1);
    EXPECT_EQ(mocks.run_file()["outcome"], "ABORTED");
}

TEST_F(Runner, LeavesAnErrorBehindIfItNeverComesToItsEnd) {
    SortedJson while_running;
    std::size_t logged = 0;
    mocks.before_move = [&](std::size_t move) {
        if (move == 2) {
            while_running = mocks.run_file();
            logged = mocks.events("pose").size();
        }
        if (move == 3)
            mocks.stop.request_stop();
    };
    mocks.run();
    EXPECT_EQ(while_running["outcome"], "ERROR");
    EXPECT_EQ(while_running["poses_visited"], 0) << "that the log has";
    EXPECT_EQ(logged, 2u);
}

// x reads 0.3, 0.5 and 1.0 mm too far: after settling and after each of the two frames. Their mean
// is 0.6; the deviation is sqrt((0.09 + 0.01 + 0.16) / 2), by hand.
TEST_F(Runner, TakesThePoseFromWhatItReadsDuringTheExposures) {
    std::vector<double> further;
    mocks.on_status = [&](std::vector<AxisStatus>& axes) {
        if (!further.empty()) {
            axes[0].position += further.front();
            further.erase(further.begin());
        }
    };
    mocks.before_move = [&](std::size_t move) {
        if (move == 2)
            mocks.stop.request_stop();
        further = {0, 0, 0.3, 0.5, 1.0};  // twice while it settles for 40 ms
    };
    const QualifyResult result = mocks.run();
    ASSERT_EQ(result.poses.size(), 2u);
    const AnalysedPose& pose = result.poses[0];
    EXPECT_NEAR(pose.read_back[0] - pose.target[0], 0.6, 1e-12);
    EXPECT_NEAR(pose.read_back_deviation[0], std::sqrt(0.13), 1e-12);
    EXPECT_NEAR(pose.read_back_uncertainty[0], std::sqrt(0.13 / 3), 1e-12);
    EXPECT_EQ(pose.read_back_deviation[1], 0.0);
    EXPECT_NEAR(pose.base_from_carriage.translation.x(), pose.read_back[0], 1e-12);
    // Scale 30 ppm and repeatability 2 um are declared as well.
    const double scale = 30e-6 * pose.read_back[0];
    EXPECT_NEAR(pose.stage_covariance(3, 3), 0.13 / 3 + 4e-6 + scale * scale, 1e-12);
}

// What may happen to axes at rest, and what the run says about it.
struct Disturbance {
    void (*happens)(AxisStatus& axis);
    const char* cause;
};
class RunnerAtRest : public Runner, public testing::WithParamInterface<Disturbance> {};
INSTANTIATE_TEST_SUITE_P(
    OfEachKind, RunnerAtRest,
    testing::Values(
        Disturbance{[](AxisStatus& axis) { axis.emergency_stop = true; }, ": emergency stop"},
        Disturbance{[](AxisStatus& axis) { axis.alarm = 12; }, ": alarm 12"},
        Disturbance{[](AxisStatus& axis) { axis.limit = true; }, " is at a limit switch"}));

// During an exposure at the third pose: the pose's other frame is not taken.
TEST_P(RunnerAtRest, EndsWhenItHappensDuringAnExposure) {
    int pictures_since = 0;
    mocks.on_status = [&](std::vector<AxisStatus>& axes) {
        if (pictures_since > 0)
            GetParam().happens(axes[2]);
    };
    mocks.picture = [&](const CaptureSettings&) {
        pictures_since += mocks.moves == 3;
        return StationOfMocks::gray();
    };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::error);
    EXPECT_EQ(result.reason,
              std::string("fake stage: read the positions: axis z") + GetParam().cause);
    EXPECT_EQ(result.poses.size(), 2u);
    EXPECT_EQ(pictures_since, 1);
    EXPECT_EQ(mocks.moves, 3);
    EXPECT_EQ(mocks.stops, 1);
    EXPECT_EQ(mocks.events("axes stopped").at(0)["detail"], "confirmed");
    EXPECT_THAT(result.remarks, Not(Contains(HasSubstr("stand still"))));
}

// While the stage settles after the third move: 40 ms, asked every 20 ms.
TEST_P(RunnerAtRest, EndsWithinOnePollPeriodWhileTheAxesSettle) {
    std::optional<Instant> happened, seen;
    mocks.on_status = [&](std::vector<AxisStatus>& axes) {
        if (mocks.moves != 3)
            return;
        happened = happened.value_or(mocks.clock.now() + std::chrono::milliseconds(1));
        if (mocks.clock.now() < *happened)
            return;
        seen = seen.value_or(mocks.clock.now());
        GetParam().happens(axes[2]);
    };
    const QualifyResult result = mocks.run();
    EXPECT_THAT(result.reason, HasSubstr(GetParam().cause));
    ASSERT_TRUE(seen);
    EXPECT_LE(*seen - *happened, std::chrono::milliseconds(20));
    EXPECT_EQ(mocks.moves, 3);
    EXPECT_EQ(mocks.stops, 1);
    EXPECT_EQ(result.poses.size(), 2u);
}

TEST_F(Runner, NamesWhatIsDeclaredAsExact) {
    EXPECT_THAT(mocks.run().remarks, Not(Contains(HasSubstr("exact"))));
    std::filesystem::remove_all(mocks.record());
    mocks.station.stage.axes[1].scale_uncertainty = 0.0;
    mocks.station.marker_flatness_mm = 0.0;
    EXPECT_THAT(
        mocks.run().remarks,
        Contains("declared with an uncertainty of 0, so taken for exact: scale of y, marker "
                 "flatness. Without its key each is unknown"));
}

TEST_F(Runner, RecordsTheOperatorsWordThatAxesAreHomed) {
    EXPECT_THAT(mocks.run().remarks, Not(Contains(HasSubstr("--homed"))));
    std::filesystem::remove_all(mocks.record());
    mocks.homed = true;
    EXPECT_THAT(mocks.run().remarks, Contains(HasSubstr("on the operator's word (--homed)")));
}

TEST(RunnerWithForbiddenBoxes, KeepsOutOfThem) {
    StationOfMocks mocks(replaced(station_text, "  profile: generic\n",
                                  "  profile: generic\n"
                                  "  forbidden: [{name: lens, x: [-20, 20], z: [40, 90]}]\n"));
    int inside = 0;
    mocks.before_move = [&](std::size_t) {
        inside +=
            !mocks.carriage.empty() && std::abs(mocks.carriage[0]) < 20 && mocks.carriage[2] > 40;
    };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.poses.size(), 25u);
    EXPECT_EQ(inside, 0);
    EXPECT_GT(mocks.moves, 25);
    EXPECT_EQ(mocks.run_file()["stage"]["forbidden"][0]["z"][1], 90.0);
}

TEST_F(Runner, TouchesNothingWhenThePlanLeavesTheSoftLimits) {
    mocks.station.plan.volume[1].high = 70;  // y ends at 55
    EXPECT_THROW(mocks.run(), ConfigError);
    EXPECT_EQ(mocks.opened, 0);
    EXPECT_FALSE(std::filesystem::exists(mocks.folder / "record"));
}

TEST_F(Runner, RefusesACameraThatTheCalibrationDoesNotBelongTo) {
    mocks.on_camera = [](FakeCamera& camera) { camera.identity_.serial = "CAM-8"; };
    EXPECT_THAT(config_error_of([&] { mocks.run(); }),
                HasSubstr("camera.yml: serial: the calibration is of camera CAM-7"));
    EXPECT_EQ(mocks.moves, 0);
    EXPECT_FALSE(std::filesystem::exists(mocks.folder / "record"));
}

TEST_F(Runner, GoesOnWithTheOtherFramesOfAPoseWhenOneIsBroken) {
    mocks.on_camera = [](FakeCamera& camera) {  // retries 3: one frame lost for good
        camera.script.assign(4, FrameStatus::corrupt);
    };
    mocks.stop_before(2);
    const QualifyResult result = mocks.run();
    ASSERT_EQ(result.poses.size(), 2u);
    EXPECT_EQ(result.poses[0].frames[0].status, FrameStatus::corrupt);
    EXPECT_EQ(result.poses[0].frames[0].file, "");
    EXPECT_EQ(result.poses[0].frames[1].file, "frames/0000_1.png");
    EXPECT_FALSE(std::filesystem::exists(mocks.folder / "record/frames/0000_0.png"));
}

// On a link that loses packets: the first pose's two frames fail with their three retries, then one
// comes.
TEST_F(Runner, TakesTheFramesOfAPoseAgainWhenNoneIsComplete) {
    mocks.on_camera = [](FakeCamera& camera) {
        camera.script.assign(8 + 4, FrameStatus::corrupt);
        camera.missing_packets = 75;
    };
    mocks.stop_before(2);
    const QualifyResult result = mocks.run();
    ASSERT_EQ(result.poses.size(), 2u);
    EXPECT_EQ(result.poses[0].frames.size(), 2u);
    EXPECT_EQ(result.poses[0].readings.size(), 3u);
    EXPECT_EQ(result.poses[0].frames[1].file, "frames/0000_1.png");
    EXPECT_THAT(result.remarks, Contains(HasSubstr("net.core.rmem_max")));
    EXPECT_EQ(mocks.events("remark").size(), 1u);
    mocks.stop = {};
    EXPECT_EQ(mocks.read().result.poses.size(), 2u);
}

TEST_F(Runner, EndsWhenNoFrameOfAPoseIsComplete) {
    mocks.on_camera = [](FakeCamera& camera) { camera.script.assign(80, FrameStatus::corrupt); };
    EXPECT_EQ(mocks.run().outcome, RunOutcome::error);
    EXPECT_THAT(mocks.run_file()["reason"].get<std::string>(),
                HasSubstr("none of 20 is complete; the last one: corrupt"));
}

TEST_F(Runner, TakesFramesOnlyAfterTheStageHasSettled) {
    mocks.stop_before(3);
    const QualifyResult result = mocks.run();
    for (const AnalysedPose& pose : result.poses) {
        EXPECT_NEAR(*pose.settled_s - pose.move_start_s, 0.040, 1e-9);
        EXPECT_GT(pose.frames[0].exposure_start_s, *pose.settled_s);
        EXPECT_GT(pose.frames[1].exposure_start_s, pose.frames[0].exposure_start_s);
    }
}

TEST_F(Runner, EndsAfterThreePosesWithoutTheMarkerAndSaysWhatIsSeenInstead) {
    StationFile other = mocks.station;
    other.marker = parse_marker("apriltag:36h11:17@60mm", "test");
    mocks.picture = [shown = StationOfMocks::pictured(other)](const auto&) { return shown; };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::error);
    EXPECT_EQ(mocks.moves, 3);
    EXPECT_EQ(result.poses.size(), 3u);
    EXPECT_EQ(mocks.stops, 1);
    EXPECT_EQ(result.reason,
              "camera genicam:127.0.0.1: see the marker: apriltag:36h11:5@60mm is in none of the "
              "first 3 poses; seen instead: apriltag:36h11:17. Compare `marker` in station.yaml "
              "with the one that is mounted");
}

TEST_F(Runner, SaysWhereToLookWhenNoMarkerIsSeenAtAll) {
    mocks.picture = [](const auto&) { return StationOfMocks::gray(); };
    const std::string reason = mocks.run().reason;
    EXPECT_THAT(reason, HasSubstr("no other tag is seen either; the whole photograph spans 0 gray "
                                  "values: empty, dark or without contrast. Look at "));
    EXPECT_THAT(reason, HasSubstr("record/frames/0002_0.png"));
}

// At the edge of the view a pose may miss the marker: one of three that shows it is enough.
TEST_F(Runner, GoesOnWhenOneOfTheFirstThreePosesShowsTheMarker) {
    mocks.picture = [&](const auto&) { return mocks.moves == 3 ? mocks.marked() : mocks.gray(); };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::inconclusive) << result.reason;
    EXPECT_EQ(result.poses.size(), 25u);
}

TEST_F(Runner, PassesATrueCamera) {
    show_a_true_camera(mocks);
    const QualifyResult result = mocks.run();
    ASSERT_TRUE(result.analysis) << result.reason;
    EXPECT_EQ(result.outcome, RunOutcome::pass) << testing::PrintToString(result.analysis->reasons);
    EXPECT_EQ(mocks.run_file()["detection"]["rate"], 1.0);
    EXPECT_EQ(mocks.run_file()["measurements"].size(), 2u);
    int renders = 0;
    for (const AnalysedPose& pose : result.poses)
        renders += !pose.render_file.empty() &&
                   std::filesystem::exists(mocks.folder / "record" / pose.render_file);
    EXPECT_EQ(renders, 15);
    for (const AnalysedPose& pose : result.poses) {
        EXPECT_EQ(pose.residual.has_value(), pose.hold_out);
        if (pose.residual) {
            EXPECT_LT(pose.residual->rms_gray, 1.0) << "pose " << pose.index;
        }
    }
}

TEST_F(Runner, LogsTheRoomWithEveryPoseAndReadsItBack) {
    int asked = 0;
    mocks.climate = [&] { return ClimateReading{0.0, 20.0 + 0.1 * asked++, 45.5}; };
    const QualifyResult result = mocks.run();
    ASSERT_EQ(result.environment.readings.size(), result.poses.size());
    EXPECT_EQ(mocks.events("climate").at(2)["temperature_c"], 20.2);
    EXPECT_EQ(mocks.events("climate").at(2)["humidity_percent"], 45.5);
    const RunEnvironment read = mocks.read().result.environment;
    ASSERT_EQ(read.readings.size(), result.poses.size());
    EXPECT_EQ(read.readings[2].t_s, result.environment.readings[2].t_s);
    EXPECT_EQ(read.readings[2].temperature_c, 20.2);
    EXPECT_EQ(read.readings[2].humidity_percent, 45.5);
    EXPECT_EQ(read.lost, "");
}

// It is asked no more: a dead sensor must not cost every pose its time-outs.
TEST_F(Runner, GoesOnWithoutASensorThatFailsAndSaysSo) {
    int asked = 0;
    mocks.climate = [&] {
        if (++asked == 3)
            throw DeviceError("room sensor 127.0.0.1:1503", "read register 0", "timed out");
        return ClimateReading{0.0, 20.0, {}};
    };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(asked, 3);
    EXPECT_EQ(result.poses.size(), result.plan.poses.size());
    EXPECT_EQ(result.environment.readings.size(), 2u);
    EXPECT_THAT(result.remarks, Contains(HasSubstr("room's sensor was lost")));
    EXPECT_EQ(mocks.run_file()["environment"]["lost"],
              "room sensor 127.0.0.1:1503: read register 0: timed out");
    EXPECT_EQ(mocks.read().result.environment.lost, result.environment.lost);
}

Detector told(const DetectedCorners& corners) {
    return {"told", [corners](const CodeImage&) { return Detection{corners}; }};
}

CameraModel board_camera() {
    return {.width = 640, .height = 480, .intrinsics = {700.0, 705.0, 321.7, 238.2}};
}

const Rigid camera_from_board{rotation_from_vector({0.3, -0.2, 0.5}), {-20.0, -11.0, 400.0}};

// Of a board's points those that are named; all when none is.
DetectedCorners seen(const Marker& board, const std::vector<int>& points) {
    DetectedCorners corners{0, {}, points};
    for (const Eigen::Vector3d& point : seen_points_mm(board, corners))
        corners.pixels.push_back(
            Projector(board_camera()).project(camera_from_board * point).value());
    return corners;
}

TEST(PartialMarker, HasAPoseByThePointsThatAreSeen) {
    const Marker board = parse_marker("charuco:4X4_50:6x5@12mm/9mm", "test");
    Detector detector = told(seen(board, {2, 3, 4, 7, 8, 9, 13}));
    const PhotoPose pose = find_marker("photo.png", {}, detector, Projector(board_camera()), board);
    ASSERT_TRUE(pose.estimate) << pose.failure;
    EXPECT_LT(left_difference(camera_from_board, pose.estimate->camera_from_marker).norm(), 1e-6);
}

TEST(PartialMarker, IsNotDetectedWhereMeansOverFramesAreTaken) {
    const Marker board = parse_marker("charuco:4X4_50:6x5@12mm/9mm", "test");
    Detector part = told(seen(board, {2, 3, 4, 7, 8, 9, 13})), whole = told(seen(board, {}));
    FrameRecord partly, wholly;
    detect_frame(part, {}, partly);
    detect_frame(whole, {}, wholly);
    EXPECT_TRUE(partly.corners.empty());
    EXPECT_EQ(partly.detection, "marker seen in part only");
    EXPECT_EQ(wholly.corners.size(), 20u);
    EXPECT_EQ(wholly.detection, "");
}

// One frame of five is of the pose before; of two nobody can say which one is.
TEST(AverageCorners, LeaveOutAFrameOfAnotherMoment) {
    VisitedPose pose;
    for (int i = 0; i < 5; ++i) {
        FrameRecord& frame = pose.frames.emplace_back();
        const double off = (i == 2 ? 7.0 : 0.0) + 0.01 * i;
        frame.corners = {{100.0 + off, 50.0}, {140.0, 52.0 + off}, {141.0, 90.0}, {99.0, 91.0}};
    }
    VisitedPose two = pose;
    two.frames.erase(two.frames.begin(), two.frames.begin() + 2);
    two.frames.resize(2);
    average_corners(pose);
    EXPECT_EQ(pose.detections, 4);
    EXPECT_TRUE(pose.frames[2].corners.empty());
    EXPECT_EQ(pose.frames[2].detection,
              "the corners are 4.94 px from where the pose's other frames show the marker");
    EXPECT_NEAR(pose.corners[0].x(), 100.0 + 0.01 * (0 + 1 + 3 + 4) / 4.0, 1e-12);
    average_corners(two);
    EXPECT_EQ(two.detections, 2);
    EXPECT_GT(two.corner_noise->variance_px2, 1.0);
}

}  // namespace
}  // namespace etalon
