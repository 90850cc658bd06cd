// The GenICam backend against a GigE Vision camera on 127.0.0.1: real protocols, real sockets, the
// machine's stock receive buffer.

#include <atomic>
#include <future>

#include "tests/loopback/gige_rig.h"

namespace etalon {
namespace {

using Rig = GigeRig;

GigeCameraOptions small(int bits = 8) {
    return {.width = 67, .height = 41, .bits = bits};
}

TEST(GenicamCamera, PassesFramesOf512x384WholeWithTheStockReceiveBuffer) {
    Rig rig(GigeCameraOptions{});
    auto camera = rig.armed();
    for (int i = 0; i < 20; ++i) {
        rig.show(picture(512, 384, 8, i));
        const Frame frame = camera->frame_after(rig.clock_.now(), 5, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        ASSERT_TRUE(same(frame.image.pixels, rig.shown().pixels));
    }
}

// A frame that comes after its time-out shows an old position. It must not be taken for the answer
// to the next trigger.
TEST(GenicamCamera, DoesNotTakeALateFrameForTheAnswerToTheNextTrigger) {
    SteadyClock clock;
    std::promise<void> release;
    std::shared_future<void> released(release.get_future());
    std::atomic<bool> dawdle = false;
    std::atomic<int> number = 10;
    GigeCamera device(small(), [&, released](const CaptureSettings&) {
        const CodeImage seen = picture(67, 41, 8, number);  // the exposure
        if (dawdle)
            released.wait_for(10s);  // not for ever: the camera may be gone by then
        return seen;
    });
    auto camera = open_camera("genicam:127.0.0.1", {.frame_timeout = 100ms}, clock);
    camera->configure({});
    camera->arm();
    dawdle = true;
    EXPECT_EQ(camera->frame_after(clock.now(), 0, {}).status, FrameStatus::timed_out);
    number = 20;
    release.set_value();
    const Frame frame = camera->frame_after(clock.now(), 5, {});
    ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_TRUE(same(frame.image.pixels, picture(67, 41, 8, 20).pixels));
}

TEST(GenicamCamera, TakesTheWrapOfTheFrameCounterForNoLoss) {
    Rig rig(small());  // the fake camera counts from about 65400 on
    auto camera = rig.armed();
    std::set<std::uint64_t> ids;
    for (int i = 0; i < 180; ++i)
        ids.insert(camera->frame_after(rig.clock_.now(), 0, {}).id);
    EXPECT_EQ(ids.size(), 180u);
    EXPECT_LT(*ids.begin(), 180u) << "the counter did not wrap";
    EXPECT_EQ(camera->statistics().delivered, 180);
    EXPECT_EQ(camera->statistics().rejected, 0);
}

TEST(GenicamCamera, LeavesTheDevicesOwnSizeAndExposureWhenNoneIsAsked) {
    Rig rig(small());
    const CaptureSettings actual = rig.open()->configure({});
    EXPECT_EQ(actual.width, 67);
    EXPECT_EQ(actual.height, 41);
    EXPECT_EQ(actual.exposure, 10000us);  // the fake camera's default
}

TEST(GenicamCamera, NeverHandsOnAFrameOfAnotherSize) {
    Rig rig(small());
    auto camera = rig.armed();
    rig.device_->change_size_unasked(67, 40);
    const Frame frame = camera->frame_after(rig.clock_.now(), 2, {});
    EXPECT_EQ(frame.status, FrameStatus::short_frame) << frame.status_detail;
    EXPECT_TRUE(frame.image.pixels.empty());
    EXPECT_EQ(camera->statistics().rejected, 3);
    EXPECT_EQ(camera->statistics().delivered, 0);
}

TEST(GenicamCamera, TriggersAgainWhenPacketsAreLostAndHandsOnOnlyWholeFrames) {
    // 12 kB: leader, 9 packets, trailer.
    Rig rig({.width = 151, .height = 80, .packet_loss = 0.02});
    auto camera = rig.armed({.frame_timeout = 300ms});
    // The chance that 60 frames of 11 packets lose none is 0.98^660 = 2e-6; that one of them fails
    // 13 times in a row, with a chance of 0.2 each, 60 * 8e-10.
    for (int i = 0; i < 60; ++i) {
        rig.show(picture(151, 80, 8, i));
        const Frame frame = camera->frame_after(rig.clock_.now(), 12, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        ASSERT_TRUE(same(frame.image.pixels, rig.shown().pixels));
    }
    EXPECT_EQ(camera->statistics().delivered, 60);
    EXPECT_GT(camera->statistics().rejected, 0);
}

TEST(GenicamCamera, IsRefusedWhileAnotherProgramControlsIt) {
    Rig rig(small());
    auto camera = rig.open();
    EXPECT_THROW(rig.open(), DeviceError);
    EXPECT_EQ(camera->identity().model, "Fake");
    EXPECT_EQ(camera->identity().serial, "TWIN");
}

TEST(GenicamCamera, SaysWithinSecondsThatNobodyAnswers) {
    SteadyClock clock;
    const Instant before = clock.now();
    EXPECT_THROW(open_camera("genicam:127.0.0.1", {}, clock), DeviceError);
    EXPECT_LT(clock.now() - before, 5s);
}

TEST(ListCameras, NamesEveryBackendAndFindsTheCameraOnLoopback) {
    Rig rig(small());
    std::set<std::string> names, found;
    for (const CameraBackend& backend : list_cameras()) {
        names.insert(backend.name);
        EXPECT_FALSE(backend.detail.empty());
        for (const CameraIdentity& camera : backend.cameras)
            found.insert(camera.uri);
    }
    EXPECT_EQ(names, (std::set<std::string>{"files", "genicam", "libcamera", "v4l2"}));
    EXPECT_TRUE(found.count("genicam:Aravis-Fake-TWIN"));
}

TEST(CameraBackends, AreNamedWithoutAskingForCameras) {
    Rig rig(small());
    const Instant before = SteadyClock().now();
    for (const CameraBackend& backend : camera_backends()) {
        EXPECT_FALSE(backend.detail.empty());
        EXPECT_TRUE(backend.cameras.empty()) << backend.name;
    }
    EXPECT_LT(SteadyClock().now() - before, 500ms);  // the networks are given a second
}

TEST(GigeCamera, RefusesAPortThatIsTaken) {
    Rig rig(small());
    EXPECT_THROW(Rig second(small()), DeviceError);
}

TEST(GigeCamera, RefusesOptionsThatMakeNoCamera) {
    const auto source = [](const CaptureSettings&) { return CodeImage{}; };
    GigeCameraOptions none = small(), deep = small(), nameless = small(), lossy = small();
    none.width = 0;
    deep.bits = 17;
    nameless.serial = "sixteen letters!";
    lossy.packet_loss = 1.5;
    for (const GigeCameraOptions& wrong : {none, deep, nameless, lossy})
        EXPECT_THROW(GigeCamera(wrong, source), ConfigError);
}

}  // namespace
}  // namespace etalon
