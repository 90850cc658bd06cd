#include "station/devices/capture_run.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "core/file/text.h"
#include "tests/fakes/fake_camera.h"
#include "tests/file_size_limit.h"
#include "tests/temporary_folder.h"

namespace etalon {
namespace {

using nlohmann::json;
using testing::HasSubstr;

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

}  // namespace
}  // namespace etalon
