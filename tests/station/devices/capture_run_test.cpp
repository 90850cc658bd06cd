#include "station/devices/capture_run.h"

#include <nlohmann/json.hpp>

#include "station/devices/live_view.h"
#include "tests/fakes/fake_camera.h"
#include "tests/test.h"

namespace etalon {
namespace {

using nlohmann::json;

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

    CaptureResult run() {
        return capture_frames(camera_, request_, clock_, stop_.get_token(),
                              [this](const Frame&) { ++seen_; });
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
    const CaptureResult result =
        capture_frames(camera_, request_, clock_, stop_.get_token(), [this](const Frame&) {
            if (++seen_ == 2)
                camera_.lose_once();
        });
    EXPECT_EQ(result.reason, "");
    EXPECT_EQ(result.complete, 3);
    EXPECT_EQ(result.statistics.reconnects, 1);
    EXPECT_THAT(read_text(request_.out / "events.jsonl"), HasSubstr("camera reconnected"));
}

TEST_F(CaptureRun, EndsWhenAskedTo) {
    request_.frames = 0;
    const CaptureResult result =
        capture_frames(camera_, request_, clock_, stop_.get_token(), [this](const Frame&) {
            if (++seen_ == 5)
                stop_.request_stop();
        });
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
