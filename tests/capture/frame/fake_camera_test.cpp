#include "tests/fakes/fake_camera.h"

#include <gtest/gtest.h>

#include "core/program/errors.h"

namespace etalon {
namespace {

CodeImage grey(const CaptureSettings&) {
    return {cv::Mat(5, 7, CV_8UC1, cv::Scalar(99)), 8};
}

TEST(FakeCamera, KeepsTheContractOfTheStates) {
    VirtualClock clock;
    FakeCamera camera(grey, clock);
    EXPECT_THROW(camera.arm(), DeviceError);
    camera.configure({});
    EXPECT_THROW(camera.frame_after(clock.now(), 0, {}), DeviceError);
    camera.arm();
    EXPECT_THROW(camera.configure({}), DeviceError);
    const Instant t = clock.now() + std::chrono::milliseconds(30);
    EXPECT_GT(camera.frame_after(t, 0, {}).exposure_start, t);
}

TEST(FakeCamera, FailsAsScriptedAndTriggersAgain) {
    VirtualClock clock;
    FakeCamera camera(grey, clock);
    camera.configure({});
    camera.arm();
    camera.script = {FrameStatus::corrupt, FrameStatus::short_frame, FrameStatus::complete,
                     FrameStatus::lost};
    const Frame good = camera.frame_after(clock.now(), 5, {});
    EXPECT_EQ(good.status, FrameStatus::complete);
    EXPECT_EQ(good.image.pixels.at<std::uint8_t>(4, 6), 99);
    EXPECT_EQ(camera.statistics().rejected, 2);
    const Frame bad = camera.frame_after(clock.now(), 0, {});
    EXPECT_EQ(bad.status, FrameStatus::lost);
    EXPECT_TRUE(bad.image.pixels.empty());
}

TEST(FakeCamera, IsGoneAfterTheTriggersThatWereLeft) {
    VirtualClock clock;
    FakeCamera camera(grey, clock);
    camera.triggers_left = 2;
    camera.configure({});
    camera.arm();
    camera.frame_after(clock.now(), 0, {});
    camera.frame_after(clock.now(), 0, {});
    EXPECT_THROW(camera.frame_after(clock.now(), 0, {}), DeviceError);
}

}  // namespace
}  // namespace etalon
