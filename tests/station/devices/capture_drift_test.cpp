#include <nlohmann/json.hpp>

#include "sim/render/renderer.h"
#include "station/devices/capture_run.h"
#include "station/devices/drift_report.h"
#include "station/devices/live_view.h"
#include "tests/fakes/fake_camera.h"
#include "tests/station/built_program.h"

namespace etalon {
namespace {

using nlohmann::json;

constexpr const char* board = "chessboard:7x5@10mm";
constexpr double amplitude_px = 1.0, time_constant_min = 4.0;

// Where the board's image is: a warm-up along x.
double warm_up_px(double minutes) {
    return amplitude_px * (1.0 - std::exp(-minutes / time_constant_min));
}

// A board at about 2 px/mm, a little tilted and turned: square before the camera all its corners
// would lie at the same place in their pixels, and their common error there, 0.15 px in sharp
// images, would be taken for a movement.
CameraModel small_camera() {
    return {.width = 200, .height = 150, .intrinsics = {300.0, 300.0, 99.7, 74.2}};
}

Rigid pose_at(double minutes) {
    Vector6d pose;
    pose << 0.15, -0.2, 0.13, -29.0 + 0.5 * warm_up_px(minutes), -23.0, 155.0;
    return rigid_from_vector(pose);
}

CodeImage photograph(double minutes) {
    const CameraModel camera = small_camera();
    const Marker marker = parse_marker(board, "test");
    return SensorModel(camera).expose(
        Renderer(camera).render({{{marker.grid, pose_at(minutes)}}, 0.8}).radiance);
}

// How far the middle of the board's corners is from where it was at first, along x.
double true_shift_px(double minutes) {
    const Projector projector(small_camera());
    const Marker marker = parse_marker(board, "test");
    double sum = 0.0;
    for (const Eigen::Vector3d& point : marker.points_mm)
        sum += projector.project(pose_at(minutes) * point)->x() -
               projector.project(pose_at(0.0) * point)->x();
    return sum / static_cast<double>(marker.points_mm.size());
}

class CaptureDrift : public testing::Test {
protected:
    CaptureDrift()
        : camera_([this](const CaptureSettings&) { return photograph(minutes()); }, clock_) {
        request_.settings.width = 200;
        request_.settings.height = 150;
        request_.interval = 15s;
        request_.frames = 200;
    }

    double minutes() const {
        return std::chrono::duration<double, std::ratio<60>>(clock_.now().time_since_epoch())
            .count();
    }
    DriftResult watch() {
        return watch_drift(camera_, make_target_finder(board, "test"), request_, clock_,
                           stop_.get_token(), [this](const DriftMonitor&) { on_frame_(); });
    }

    VirtualClock clock_;
    FakeCamera camera_;
    DriftRequest request_;
    std::stop_source stop_;
    std::function<void()> on_frame_ = [] {};
};

// 1 px exp(-t / 4 min) drifts by 0.02 px/min at 4 ln(0.25 / 0.02) = 10.1 min. A line over the last
// 5 min is as steep half a window later, and the uncertainty takes some minutes more.
TEST_F(CaptureDrift, EndsWhenARenderedWarmUpIsOver) {
    const DriftResult result = watch();
    EXPECT_EQ(result.reason, "");
    ASSERT_TRUE(result.stable);
    EXPECT_GT(result.duration.count(), 10.1);
    EXPECT_LT(result.duration.count(), 25.0);
    EXPECT_FALSE(camera_.is_armed());
    EXPECT_TRUE(result.monitor.jumps().empty());
    // 35 corners, whose errors of 0.1 px change with their place in the pixel.
    for (const DriftFrame& frame : result.monitor.frames())
        EXPECT_NEAR(frame.movement[0], true_shift_px(frame.time.count()), 0.04)
            << frame.time.count();
    EXPECT_EQ(drift_sentence(result),
              fmt::format("drift {:.3f} px/min stable after {:.1f} min",
                          result.monitor.rates().back().worst_px_per_min, result.duration.count()));
}

TEST_F(CaptureDrift, TakesAFramePerInterval) {
    request_.frames = 9;
    const DriftResult result = watch();
    ASSERT_EQ(result.monitor.frames().size(), 9u);
    EXPECT_NEAR(result.monitor.frames().back().time.count(), 8 * 0.25, 1e-6);
    EXPECT_FALSE(result.stable);
    EXPECT_THAT(drift_sentence(result), HasSubstr("drift not measured in 2.0 min"));
}

TEST_F(CaptureDrift, KeepsWhatWasSeenWhenTheCameraIsGoneOrAStopIsAskedFor) {
    camera_.triggers_left = 5;
    const DriftResult gone = watch();
    EXPECT_THAT(gone.reason, HasSubstr("lost"));
    EXPECT_EQ(gone.monitor.frames().size(), 5u);
    camera_.triggers_left = -1;
    camera_.reconnect(clock_.now(), {});
    int left = 3;
    on_frame_ = [&] {
        if (--left == 0)
            stop_.request_stop();
    };
    const DriftResult stopped = watch();
    EXPECT_EQ(stopped.reason, "interrupted");
    EXPECT_EQ(stopped.monitor.frames().size(), 3u);
    EXPECT_FALSE(camera_.is_armed());
}

TEST_F(CaptureDrift, CountsBadFramesAsNotSeen) {
    camera_.script = {FrameStatus::complete, FrameStatus::corrupt, FrameStatus::complete};
    request_.retries = 0;
    request_.frames = 3;
    const DriftResult result = watch();
    EXPECT_TRUE(result.monitor.frames()[0].seen);
    EXPECT_FALSE(result.monitor.frames()[1].seen);
    EXPECT_TRUE(result.monitor.frames()[2].seen);
}

class DriftCommand : public testing::Test {
protected:
    DriftCommand() {
        arguments_.camera = "files:" + (folder_ / "photos").string();
        arguments_.drift = true;
        arguments_.marker = board;
        arguments_.out = folder_ / "drift";
        arguments_.interval_s = 15.0;
        std::filesystem::create_directories(folder_ / "photos");
    }

    void record(int frames, double from_minute = 0.0) {
        for (int frame = 0; frame < frames; ++frame)
            write_image(folder_ / "photos" / fmt::format("{:03}.png", frame),
                        photograph(from_minute + 0.25 * frame));
    }
    Finished run() const {
        return finished([this] { return run_capture(arguments_); });
    }
    nlohmann::json result() const {
        return nlohmann::json::parse(read_text(arguments_.out / "drift.json"));
    }

    TemporaryFolder folder_;
    CaptureArguments arguments_;
};

TEST_F(DriftCommand, SaysThatARecordedCameraWasStableAndLeavesARecord) {
    record(30, 30.0);  // long after the warm-up
    const Finished done = run();
    EXPECT_EQ(done.exit_code, 0);
    EXPECT_THAT(done.out,
                testing::MatchesRegex("drift 0\\.00[0-9] px/min stable after [34]\\.[0-9] "
                                      "min\nreport .*/drift/report\\.html\n"));
    const nlohmann::json json = result();
    EXPECT_EQ(json["etalon"], "drift/1");
    EXPECT_EQ(json["stable"], true);
    EXPECT_EQ(json["target"], board);
    EXPECT_EQ(json["camera"]["width"], 200);
    EXPECT_EQ(json["rates"].back()["bound_px_per_min"] < 0.02, true);
    const auto rows = split(read_text(arguments_.out / "drift.csv"), '\n');
    EXPECT_EQ(rows.front(),
              "time_min,seen,part,shift_x_px,shift_y_px,scale_ppm,rotation_urad,misfit_px");
    EXPECT_EQ(rows.size(),
              json["frames"].get<std::size_t>() + 2);  // header and the last line's end
    for (std::size_t i = 1; i + 1 < rows.size(); ++i)
        EXPECT_EQ(split(rows[i], ',').size(), 8u);
    const std::string page = read_text(arguments_.out / "report.html");
    EXPECT_THAT(page, HasSubstr("STABLE"));
    EXPECT_THAT(page, HasSubstr("<svg"));
    expect_readable_page(page);
    EXPECT_THAT(page, HasSubstr("Whether the camera moved or the target"));
}

TEST_F(DriftCommand, IsInconclusiveWhileTheCameraWarmsUp) {
    record(24);
    arguments_.frames = 24;
    const Finished done = run();
    EXPECT_THAT(done.out, HasSubstr(" px/min not stable in 5.8 min\n"));
    EXPECT_EQ(done.exit_code, 2);
    EXPECT_EQ(result()["stable"], false);
    EXPECT_THAT(read_text(arguments_.out / "report.html"), HasSubstr("it drifts"));
}

TEST_F(DriftCommand, EndsWithFourAndItsRecordWhereTheRecordingEndsEarly) {
    record(4);
    EXPECT_EQ(run().exit_code, 4);
    EXPECT_THAT(result()["reason"].get<std::string>(), HasSubstr("all 4 images were shown"));
    EXPECT_TRUE(result()["rates"].empty());
}

TEST_F(DriftCommand, SaysWhereTheTargetIsNeverSeen) {
    for (int frame = 0; frame < 3; ++frame)
        write_image(folder_ / "photos" / fmt::format("{}.png", frame),
                    {cv::Mat(150, 200, CV_8UC1, cv::Scalar(90)), 8});
    arguments_.frames = 3;
    const Finished done = run();
    EXPECT_THAT(done.out, HasSubstr("drift not measured"));
    EXPECT_EQ(done.exit_code, 2);
    EXPECT_EQ(result()["frames_without_target"], 3);
}

TEST_F(DriftCommand, RefusesWhatItCannotWatch) {
    record(1);
    const auto refused = [&](auto change) {
        CaptureArguments wrong = arguments_;
        change(wrong);
        EXPECT_THROW(run_capture(wrong), ConfigError);
        EXPECT_FALSE(std::filesystem::exists(arguments_.out));
    };
    refused([](CaptureArguments& a) { a.interval_s.reset(); });  // files do not say when
    refused([](CaptureArguments& a) { a.marker = ""; });
    refused([](CaptureArguments& a) { a.marker = "chessboard:2x2@10mm"; });
    refused([](CaptureArguments& a) { a.out = ""; });
    refused([](CaptureArguments& a) { a.interval_s = 1e-9; });
    refused([](CaptureArguments& a) { a.interval_s = 1e9; });
    refused([](CaptureArguments& a) { a.minutes = 1e300; });
}

TEST(DriftLine, FitsATerminalOf80Columns) {
    DriftMonitor monitor(drift_plan({640, 480}, Minutes(1.0 / 60.0), Minutes(10000)));
    EXPECT_LT(drift_line(monitor).size(), 80u);
    TargetPoints points{{0, {5, 7}}, {1, {500, 9}}, {2, {510, 400}}, {3, {8, 410}}};
    for (int frame = 0; frame < 400; ++frame) {
        for (auto& [id, pixel] : points)
            pixel.x() += frame == 300 ? 500.0 : 0.3 + 0.1 * (frame % 2);
        monitor.add(Minutes(9000 + frame / 60.0), points);
        EXPECT_LT(drift_line(monitor).size(), 80u) << drift_line(monitor);
    }
    monitor.add(Minutes(9999), {});
    EXPECT_THAT(drift_line(monitor), HasSubstr("not seen"));
}

// ---- capture run

// Frames of 7x5 pixels with 12 bits: 1000, 1001, ... in every pixel.
class CaptureRun : public testing::Test {
protected:
    CaptureRun()
        : camera_(
              [this](const CaptureSettings&) {
                  return CodeImage{cv::Mat(5, 7, CV_16UC1, cv::Scalar(1000 + shown_++)), 12};
              },
              clock_) {
        request_.settings.bits = 12;
        request_.settings.exposure = std::chrono::microseconds(7000);
        request_.frames = 4;
        request_.out = folder_ / "record";
    }

    CaptureResult run(int nth = 0, const std::function<void()>& at_nth = {}) {
        return capture_frames(camera_, request_, clock_, stop_.get_token(), [&](const Frame&) {
            if (++seen_ == nth)
                at_nth();
        });
    }
    json file() const { return json::parse(read_text(request_.out / "capture.json")); }

    TemporaryFolder folder_;
    VirtualClock clock_;
    int shown_ = 0, seen_ = 0;
    FakeCamera camera_;
    CaptureRequest request_;
    std::stop_source stop_;
};

TEST_F(CaptureRun, RecordsFramesWithWhatIsKnownOfThem) {
    const CaptureResult result = run();
    EXPECT_EQ(result.reason, "");
    EXPECT_EQ(result.complete, 4);
    EXPECT_EQ(seen_, 4);
    EXPECT_NEAR(*result.mean, 1001.5, 1e-9);
    EXPECT_NEAR(*result.noise, std::sqrt(5.0 / 3.0), 1e-9);  // of 0, 1, 2, 3
    EXPECT_FALSE(camera_.is_armed());
    const json recorded = file();
    EXPECT_EQ(recorded["etalon"], "capture/1");
    EXPECT_EQ(recorded["camera"]["serial"], "FAKE-7");
    EXPECT_EQ(recorded["camera"]["settings"]["exposure_us"], 7000);
    EXPECT_EQ(recorded["camera"]["settings"]["bits"], 12);
    EXPECT_EQ(recorded["camera"]["frames_delivered"], 4);
    EXPECT_EQ(recorded["frames_complete"], 4);
    EXPECT_EQ(read_image(request_.out / "frames/000002.png").pixels.at<std::uint16_t>(4, 6), 1002);
    EXPECT_NEAR(read_radiance(request_.out / "mean.tiff").at<float>(3, 2), 1001.5 / 4095, 1e-6);
}

TEST_F(CaptureRun, CanBeReplayedWithItsBadFrames) {
    camera_.script = {FrameStatus::complete, FrameStatus::corrupt, FrameStatus::complete};
    request_.retries = 0;
    EXPECT_EQ(run().complete, 3);
    VirtualClock clock;
    auto replay = open_camera("files:" + request_.out.string(), {}, clock);
    replay->configure(request_.settings);
    replay->arm();
    const auto next = [&] { return replay->frame_after(clock.now(), 0, {}); };
    EXPECT_EQ(next().image.pixels.at<std::uint16_t>(0, 0), 1000);
    EXPECT_EQ(next().status, FrameStatus::corrupt);
    const Frame third = next();
    EXPECT_EQ(third.image.pixels.at<std::uint16_t>(0, 0), 1001);
    EXPECT_EQ(third.image.bits, 12);
    EXPECT_EQ(third.id, 3u);
}

TEST_F(CaptureRun, KeepsWhatWasTakenWhenTheCameraIsGoneForGood) {
    camera_.triggers_left = 3;
    const CaptureResult result = run();
    EXPECT_EQ(result.complete, 3);
    EXPECT_THAT(result.reason, HasSubstr("lost"));
    EXPECT_EQ(file()["frames_complete"], 3);
    EXPECT_THAT(read_text(request_.out / "events.jsonl"), HasSubstr("camera not reconnected"));
}

TEST_F(CaptureRun, GoesOnWithACameraThatComesBack) {
    request_.frames = 3;
    const CaptureResult result = run(2, [&] { camera_.lose_once(); });
    EXPECT_EQ(result.reason, "");
    EXPECT_EQ(result.complete, 3);
    EXPECT_EQ(result.statistics.reconnects, 1);
    EXPECT_THAT(read_text(request_.out / "events.jsonl"), HasSubstr("camera reconnected"));
}

TEST_F(CaptureRun, EndsWhenAskedTo) {
    request_.frames = 0;
    const CaptureResult result = run(5, [&] { stop_.request_stop(); });
    EXPECT_EQ(result.complete, 5);
    EXPECT_EQ(result.reason, "");
}

TEST_F(CaptureRun, SaysThatTheDiskIsFullAndKeepsWhatFitted) {
    request_.frames = 200;
    const CaptureResult result = [this] {
        const FileSizeLimit limit(100);
        return run();
    }();
    EXPECT_THAT(result.reason, HasSubstr("cannot be written"));
    EXPECT_LT(seen_, 200);
    EXPECT_FALSE(camera_.is_armed());
}

TEST(CaptureCommand, RefusesArgumentsWithoutAPurpose) {
    CaptureArguments nothing, no_folder;
    nothing.camera = no_folder.camera = "files:missing";
    no_folder.frames = 3;
    for (const CaptureArguments& wrong : {nothing, no_folder})
        EXPECT_THROW(run_capture(wrong), ConfigError);
}

Frame frame_of(const cv::Mat& codes, int bits, Instant start) {
    return {.image = {codes, bits}, .status = FrameStatus::complete, .exposure_start = start};
}

TEST(LiveView, MeasuresRateMeanNoiseAndSaturation) {
    cv::Mat first(40, 50, CV_8UC1, cv::Scalar(100)), second;
    first(cv::Rect(0, 0, 50, 4)) = 255;  // a tenth
    cv::Mat noise(40, 50, CV_16SC1);
    cv::RNG random(7);
    random.fill(noise, cv::RNG::NORMAL, 0.0, 5.0);
    noise(cv::Rect(0, 0, 50, 4)) = 0;
    cv::add(first, noise, second, cv::noArray(), CV_8U);
    LiveView view;
    view.add(frame_of(first, 8, Instant(7s)));
    EXPECT_NEAR(view.figures().mean, 115.5, 1e-9);
    EXPECT_NEAR(view.figures().saturated, 0.1, 1e-9);
    view.add(frame_of(second, 8, Instant(7s + 40ms)));
    EXPECT_NEAR(view.figures().frames_per_second, 25.0, 1e-9);
    // Only one of the two is noisy: 5 sqrt(0.9) / sqrt(2), known to 1 / sqrt(2 * 2000) = 1.6 %.
    EXPECT_NEAR(view.figures().noise, 3.354, 5 * 0.016 * 3.354);
}

// The second differences of a step of 80 over one column are +-80 on two columns.
TEST(LiveView, MeasuresSharpnessByEdges) {
    cv::Mat sharp(20, 40, CV_8UC1, cv::Scalar(60)), soft = sharp.clone();
    sharp.colRange(20, 40) = 140;
    soft.col(20) = 100;
    soft.colRange(21, 40) = 140;
    LiveView sharp_view, soft_view;
    sharp_view.add(frame_of(sharp, 8, Instant(1s)));
    soft_view.add(frame_of(soft, 8, Instant(1s)));
    EXPECT_NEAR(sharp_view.figures().sharpness, 1000.0 * std::sqrt(2 * 80.0 * 80.0 / 40.0) / 100.0,
                1e-3);
    EXPECT_LT(soft_view.figures().sharpness, 0.6 * sharp_view.figures().sharpness);
}

TEST(LiveView, FitsATerminalOf80ColumnsAndSaysWhatIsWrong) {
    LiveView view;
    EXPECT_LT(view.line().size(), 80u);
    for (int i = 0; i < 2; ++i)
        view.add(frame_of(cv::Mat(9, 7, CV_16UC1, cv::Scalar(65535)), 16, Instant(i * 1ms)));
    Frame lost;
    lost.status = FrameStatus::lost;
    for (int i = 0; i < 12345; ++i)
        view.add(lost);
    EXPECT_NE(view.line().find("lost"), std::string::npos);
    view.add(frame_of(cv::Mat(9, 7, CV_16UC1, cv::Scalar(65535)), 16, Instant(9ms)));
    EXPECT_LT(view.line().size(), 80u) << view.line();
    EXPECT_NE(view.line().find("100.00 %"), std::string::npos);
    EXPECT_NE(view.line().find("bad 12345"), std::string::npos);
}

}  // namespace
}  // namespace etalon
