#include "station/runner.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "core/errors.h"
#include "mocks/fake_camera.h"
#include "mocks/fake_stage.h"
#include "stage/kinematics.h"
#include "station/expected_view.h"
#include "tests/station/stations.h"

namespace etalon {
namespace {

using Json = nlohmann::json;
using testing::HasSubstr;

// A station of mocks. The devices belong to the run, which destroys them: what they saw is copied
// out by the hooks.
class StationOfMocks {
public:
    explicit StationOfMocks(const std::string& text = station_text)
        : station(read_station(write_station(folder, text))),
          null_(std::fopen("/dev/null", "w")),
          progress_(null_, false, clock) {
        picture = [](const CaptureSettings&) {
            return CodeImage{cv::Mat(240, 320, CV_8UC1, cv::Scalar(130)), 8};
        };
    }
    ~StationOfMocks() { std::fclose(null_); }

    QualifyResult run() {
        const DeviceOpeners open{[this] { return opened_camera(); },
                                 [this] { return opened_stage(); }};
        return run_qualification(station, folder / "record", open, clock, progress_,
                                 stop.get_token());
    }

    std::vector<Json> events(const std::string& kind) const {
        std::vector<Json> found;
        for (const std::string& line : split(read_text(folder / "record/events.jsonl"), '\n'))
            if (!line.empty() && Json::parse(line)["event"] == kind)
                found.push_back(Json::parse(line));
        return found;
    }
    Json run_file() const { return Json::parse(read_text(folder / "record/run.json")); }

    TemporaryFolder folder;
    StationFile station;
    VirtualClock clock;
    std::stop_source stop;
    std::function<void(FakeCamera&)> on_camera = [](FakeCamera&) {};
    std::function<void(FakeStage&)> on_stage = [](FakeStage&) {};
    FakeCamera::Picture picture;
    std::function<void(std::vector<AxisStatus>&)> on_status = [](auto&) {};
    std::function<void(std::size_t move)> before_move = [](std::size_t) {};
    int opened = 0, moves = 0, stops = 0, closings = 0;  // closing a stage stops it, too
    bool stage_is_silent = false;
    std::vector<double> carriage;

private:
    // Tells what it went through when the run lets it go.
    class ObservedStage final : public Stage {
    public:
        ObservedStage(FakeStage stage, StationOfMocks& owner)
            : stage_(std::move(stage)), owner_(owner) {}
        ~ObservedStage() override { ++owner_.closings; }
        ObservedStage(const ObservedStage&) = delete;
        ObservedStage& operator=(const ObservedStage&) = delete;
        const std::vector<Axis>& axes() const override { return stage_.axes(); }
        void enable(std::stop_token token) override { stage_.enable(token); }
        void home(std::stop_token token) override { stage_.home(token); }
        void resume() override { stage_.resume(); }
        void move(std::span<const double> target, std::stop_token token) override {
            owner_.before_move(stage_.moves.size());
            stage_.move(target, token);
            owner_.moves = static_cast<int>(stage_.moves.size());
            owner_.carriage.assign(target.begin(), target.end());
        }
        void limit_speed(double share) override { stage_.limit_speed(share); }
        std::vector<double> position() override {
            if (owner_.stage_is_silent)
                throw DeviceError("stage fake", "position", "no answer");
            return stage_.position();
        }
        std::vector<AxisStatus> status() override {
            if (owner_.stage_is_silent)
                throw DeviceError("stage fake", "status", "no answer");
            auto axes = stage_.status();
            owner_.on_status(axes);
            return axes;
        }
        std::string trace() const override { return "-3 ms read registers 0..13\n"; }
        bool stop() noexcept override {
            ++owner_.stops;
            return stage_.stop();
        }

    private:
        FakeStage stage_;
        StationOfMocks& owner_;
    };

    std::unique_ptr<Camera> opened_camera() {
        ++opened;
        auto camera = std::make_unique<FakeCamera>(
            [this](const CaptureSettings& settings) { return picture(settings); }, clock);
        camera->identity_.serial = "CAM-7";
        on_camera(*camera);
        return camera;
    }
    std::unique_ptr<Stage> opened_stage() {
        ++opened;
        FakeStage stage(station.stage.axes);
        on_stage(stage);
        return std::make_unique<ObservedStage>(std::move(stage), *this);
    }

    std::FILE* null_;
    Progress progress_;
};

TEST(Runner, KeepsWhatWasMeasuredAndStopsTheAxesWhenTheStageFails) {
    StationOfMocks mocks;
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
TEST(Runner, LeavesTheLastAttemptToStopToClosingAStageThatDoesNotAnswer) {
    StationOfMocks mocks;
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

// An alarm must not look like silence: the axes of others may still move.
TEST(Runner, StopsTheAxesWhenOneHasAnAlarmWhileItRests) {
    StationOfMocks mocks;
    mocks.on_status = [&](std::vector<AxisStatus>& axes) {
        if (mocks.moves == 2)
            axes[0].alarm = 17;
    };
    EXPECT_EQ(mocks.run().outcome, RunOutcome::error);
    EXPECT_EQ(mocks.stops, 1);
    EXPECT_EQ(mocks.events("axes stopped").at(0)["detail"], "confirmed");
}

TEST(Runner, StopsTheAxesWhenTheCameraIsGone) {
    StationOfMocks mocks;
    mocks.on_camera = [](FakeCamera& camera) { camera.triggers_left = 5; };  // 2 frames a pose
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::error);
    EXPECT_EQ(result.poses.size(), 2u);
    EXPECT_GE(mocks.stops, 1);
    EXPECT_EQ(mocks.moves, 3);
}

TEST(Runner, TakesUpACameraThatWasGoneForAWhile) {
    StationOfMocks mocks;
    FakeCamera* camera = nullptr;
    mocks.on_camera = [&](FakeCamera& opened) { camera = &opened; };
    mocks.before_move = [&](std::size_t move) {
        if (move == 4)
            camera->lose_once();
    };
    const QualifyResult result = mocks.run();
    EXPECT_NE(result.outcome, RunOutcome::error) << result.reason;
    EXPECT_EQ(result.statistics.reconnects, 1);
    EXPECT_EQ(mocks.events("camera lost").size(), 1u);
    EXPECT_EQ(mocks.events("camera reconnected").size(), 1u);
    EXPECT_EQ(mocks.run_file()["camera"]["reconnects"], 1);
}

TEST(Runner, EndsAtOnceWhenStopIsRequested) {
    StationOfMocks mocks;
    mocks.before_move = [&](std::size_t move) {
        if (move == 4)
            mocks.stop.request_stop();
    };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::aborted);
    EXPECT_EQ(exit_code(result.outcome), 130);
    EXPECT_EQ(result.poses.size(), 4u);
    EXPECT_GE(mocks.stops, 1);
    EXPECT_EQ(mocks.run_file()["outcome"], "ABORTED");
}

TEST(Runner, LeavesAnErrorBehindIfItNeverComesToItsEnd) {
    StationOfMocks mocks;
    Json while_running;
    mocks.before_move = [&](std::size_t move) {
        if (move == 2)
            while_running = mocks.run_file();
        if (move == 3)
            mocks.stop.request_stop();
    };
    mocks.run();
    EXPECT_EQ(while_running["outcome"], "ERROR");
    EXPECT_EQ(while_running["poses_visited"], 2);
}

// x reads 0.3, 0.5 and 1.0 mm too far: after settling and after each of the two frames. Their mean
// is 0.6; the deviation is sqrt((0.09 + 0.01 + 0.16) / 2), by hand.
TEST(Runner, TakesThePoseFromWhatItReadsDuringTheExposures) {
    StationOfMocks mocks;
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
    const PoseRecord& pose = result.poses[0];
    EXPECT_NEAR(pose.read_back[0] - pose.planned.target[0], 0.6, 1e-12);
    EXPECT_NEAR(pose.read_back_deviation[0], std::sqrt(0.13), 1e-12);
    EXPECT_NEAR(pose.read_back_uncertainty[0], std::sqrt(0.13 / 3), 1e-12);
    EXPECT_EQ(pose.read_back_deviation[1], 0.0);
    EXPECT_NEAR(pose.stage.base_from_carriage.translation.x(), pose.read_back[0], 1e-12);
    // Scale 30 ppm and repeatability 2 um are declared as well.
    const double scale = 30e-6 * pose.read_back[0];
    EXPECT_NEAR(pose.stage.covariance(3, 3), 0.13 / 3 + 4e-6 + scale * scale, 1e-12);
}

// What may happen to axes at rest, and what the run says about it.
struct Disturbance {
    void (*happens)(AxisStatus& axis);
    const char* cause;
};
const Disturbance disturbances[] = {
    {[](AxisStatus& axis) { axis.emergency_stop = true; }, "emergency stop"},
    {[](AxisStatus& axis) { axis.alarm = 12; }, "alarm 12"},
    {[](AxisStatus& axis) { axis.limit = true; }, "at a limit"}};

// During an exposure at the third pose: the pose's other frame is not taken.
TEST(Runner, EndsWhenTheEmergencyStopIsPressedWhileTheAxesRest) {
    for (const Disturbance& disturbance : disturbances) {
        StationOfMocks mocks;
        int pictures_since = 0;
        mocks.on_status = [&](std::vector<AxisStatus>& axes) {
            if (pictures_since > 0)
                disturbance.happens(axes[2]);
        };
        mocks.picture = [&](const CaptureSettings&) {
            pictures_since += mocks.moves == 3;
            return CodeImage{cv::Mat(240, 320, CV_8UC1, cv::Scalar(130)), 8};
        };
        const QualifyResult result = mocks.run();
        EXPECT_EQ(result.outcome, RunOutcome::error);
        EXPECT_EQ(result.reason,
                  std::string("stage: read the positions: axis z: ") + disturbance.cause);
        EXPECT_EQ(result.poses.size(), 2u);
        EXPECT_EQ(pictures_since, 1);
        EXPECT_EQ(mocks.moves, 3);
        EXPECT_EQ(mocks.stops, 1);
        EXPECT_THAT(result.remarks, testing::Not(testing::Contains(HasSubstr("stand still"))));
    }
}

// While the stage settles after the third move: 40 ms, asked every 20 ms.
TEST(Runner, SeesAnEmergencyStopWithinOnePollPeriodWhileTheAxesSettle) {
    for (const Disturbance& disturbance : disturbances) {
        StationOfMocks mocks;
        std::optional<Instant> happened, seen;
        mocks.on_status = [&](std::vector<AxisStatus>& axes) {
            if (mocks.moves != 3)
                return;
            happened = happened.value_or(mocks.clock.now() + std::chrono::milliseconds(1));
            if (mocks.clock.now() < *happened)
                return;
            seen = seen.value_or(mocks.clock.now());
            disturbance.happens(axes[2]);
        };
        const QualifyResult result = mocks.run();
        EXPECT_THAT(result.reason, HasSubstr(disturbance.cause));
        ASSERT_TRUE(seen);
        EXPECT_LE(*seen - *happened, std::chrono::milliseconds(20));
        EXPECT_EQ(mocks.moves, 3);
        EXPECT_EQ(mocks.stops, 1);
        EXPECT_EQ(result.poses.size(), 2u);
    }
}

TEST(Runner, KeepsOutOfForbiddenBoxes) {
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

TEST(Runner, TouchesNothingWhenThePlanLeavesTheSoftLimits) {
    StationOfMocks mocks;
    mocks.station.plan.volume[1].high = 70;  // y ends at 55
    EXPECT_THROW(mocks.run(), ConfigError);
    EXPECT_EQ(mocks.opened, 0);
    EXPECT_FALSE(std::filesystem::exists(mocks.folder / "record"));
}

TEST(Runner, RefusesACameraThatTheCalibrationDoesNotBelongTo) {
    StationOfMocks mocks;
    mocks.on_camera = [](FakeCamera& camera) { camera.identity_.serial = "CAM-8"; };
    try {
        mocks.run();
        FAIL() << "accepted";
    } catch (const ConfigError& error) {
        EXPECT_THAT(error.what(),
                    HasSubstr("camera.yml: serial: the calibration is of camera CAM-7"));
    }
    EXPECT_EQ(mocks.moves, 0);
    EXPECT_FALSE(std::filesystem::exists(mocks.folder / "record"));
}

TEST(Runner, GoesOnWithTheOtherFramesOfAPoseWhenOneIsBroken) {
    StationOfMocks mocks;
    mocks.on_camera = [](FakeCamera& camera) {  // retries 3: one frame lost for good
        camera.script.assign(4, FrameStatus::corrupt);
    };
    mocks.before_move = [&](std::size_t move) {
        if (move == 2)
            mocks.stop.request_stop();
    };
    const QualifyResult result = mocks.run();
    ASSERT_EQ(result.poses.size(), 2u);
    EXPECT_EQ(result.poses[0].frames[0].status, FrameStatus::corrupt);
    EXPECT_EQ(result.poses[0].frames[0].file, "");
    EXPECT_EQ(result.poses[0].frames[1].file, "frames/0000_1.png");
    EXPECT_FALSE(std::filesystem::exists(mocks.folder / "record/frames/0000_0.png"));
}

TEST(Runner, EndsWhenNoFrameOfAPoseIsComplete) {
    StationOfMocks mocks;
    mocks.on_camera = [](FakeCamera& camera) { camera.script.assign(8, FrameStatus::corrupt); };
    EXPECT_EQ(mocks.run().outcome, RunOutcome::error);
    EXPECT_THAT(mocks.run_file()["reason"].get<std::string>(), HasSubstr("none is complete"));
}

TEST(Runner, TakesFramesOnlyAfterTheStageHasSettled) {
    StationOfMocks mocks;
    mocks.before_move = [&](std::size_t move) {
        if (move == 3)
            mocks.stop.request_stop();
    };
    const QualifyResult result = mocks.run();
    for (const PoseRecord& pose : result.poses) {
        EXPECT_NEAR(pose.settled_s - pose.move_start_s, 0.040, 1e-9);
        EXPECT_GT(pose.frames[0].exposure_start_s, pose.settled_s);
        EXPECT_GT(pose.frames[1].exposure_start_s, pose.frames[0].exposure_start_s);
    }
}

TEST(Runner, IsInconclusiveWhenTheMarkerIsNeverSeen) {
    StationOfMocks mocks;
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::inconclusive) << result.reason;
    EXPECT_EQ(result.poses.size(), 25u);
    EXPECT_EQ(mocks.run_file()["detection"]["rate"], 0.0);
}

// The whole chain in process: the picture is what the calibrated camera sees at the carriage's
// position, with mountings that the station is not told.
TEST(Runner, PassesATrueCamera) {
    StationOfMocks mocks;
    const ExpectedView view(mocks.station.camera.model, mocks.station.marker.grid,
                            mocks.station.background, mocks.station.white_level);
    const Rigid camera_from_base =
        rigid_from_vector((Vector6d() << 0.03, -0.02, 0.01, 4, -6, 330).finished());
    const Rigid carriage_from_marker =
        left_perturbed(mocks.station.carriage_from_marker_nominal,
                       (Vector6d() << 0.01, -0.007, 0.013, 0.3, -0.2, 0.5).finished());
    mocks.picture = [&](const CaptureSettings&) {
        return view.at(camera_from_base *
                       base_from_carriage(mocks.station.stage.axes, mocks.carriage) *
                       carriage_from_marker);
    };
    const QualifyResult result = mocks.run();
    EXPECT_EQ(result.outcome, RunOutcome::pass) << result.reason;
    EXPECT_EQ(mocks.run_file()["detection"]["rate"], 1.0);
    EXPECT_EQ(mocks.run_file()["measurements"].size(), 2u);
    int renders = 0;
    for (const PoseRecord& pose : result.poses)
        renders += !pose.render_file.empty() &&
                   std::filesystem::exists(mocks.folder / "record" / pose.render_file);
    EXPECT_EQ(renders, 15);
}

}  // namespace
}  // namespace etalon
