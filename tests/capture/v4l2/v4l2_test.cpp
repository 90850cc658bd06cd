// What the V4L2 backend makes of devices that misbehave, over a scripted one
// (tests/fakes/fake_v4l2.h); of their frames: v4l2_frames_test.cpp. The contract that all backends
// keep is tested in v4l2_frames_test.cpp.

#include <latch>
#include <opencv2/imgcodecs.hpp>

#include "tests/capture/v4l2/v4l2_fixture.h"

namespace etalon {
namespace {

// ---- finding and opening ---------------------------------------------------------------------

TEST_F(V4l2, IsOpenedByItsNodeOrItsPlaceOnTheBus) {
    const auto by_node = open();
    EXPECT_EQ(by_node->identity().uri, "v4l2:/dev/video0");
    EXPECT_EQ(by_node->identity().model, "Fake camera");
    EXPECT_EQ(by_node->identity().serial, "FAKE-7");
    EXPECT_NO_THROW(open_v4l2_camera(device_.bus, {}, clock_, device_));
    EXPECT_THROW(open_v4l2_camera("usb-elsewhere", {}, clock_, device_), DeviceError);
    EXPECT_THROW(open_v4l2_camera("/dev/video9", {}, clock_, device_), DeviceError);
}

TEST_F(V4l2, RefusesNodesThatAreNoCamera) {
    device_.captures = false;  // the metadata node beside a camera's
    EXPECT_THAT(device_error_of([&] { open(); }), HasSubstr("captures no video"));
    EXPECT_THAT(list_v4l2_cameras(device_), IsEmpty());
    device_.captures = true;
    device_.streams = false;
    EXPECT_THAT(device_error_of([&] { open(); }), HasSubstr("cannot stream"));
    EXPECT_EQ(device_.open_files(), 0);
}

TEST_F(V4l2, IsListedWithItsPlaceOnTheBus) {
    const auto found = list_v4l2_cameras(device_);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_EQ(found[0].uri, "v4l2:/dev/video0");
    EXPECT_EQ(found[0].model, "Fake camera at usb-0000:00:14.0-3");
}

TEST_F(V4l2, SaysWhenThisUserMayNotOpenIt) {
    device_.open_error = EACCES;
    EXPECT_THAT(device_error_of([&] { open(); }), HasSubstr("group \"video\""));
    const auto found = list_v4l2_cameras(device_);
    ASSERT_EQ(found.size(), 1u);
    EXPECT_THAT(found[0].model, HasSubstr("EACCES"));
}

TEST_F(V4l2, ListsFormatsAndControls) {
    device_.formats = {"GREY", "Y16 ", "H264"};
    const CameraAbilities abilities = open()->abilities();
    ASSERT_EQ(abilities.formats.size(), 3u);
    EXPECT_EQ(abilities.formats[1].name, "Y16");
    EXPECT_EQ(abilities.formats[1].bits, 16);
    EXPECT_EQ(abilities.formats[1].description, "format Y16 ");
    EXPECT_EQ(abilities.formats[2].bits, 0) << "cannot be unpacked";
    ASSERT_EQ(abilities.formats[0].sizes.size(), 2u);
    EXPECT_EQ(abilities.formats[0].sizes[1].largest, cv::Size(17, 11));
    const auto control = [&](const std::string& name) {
        for (const CameraControl& one : abilities.controls)
            if (one.name == name)
                return one;
        ADD_FAILURE() << "no " << name;
        return CameraControl{};
    };
    EXPECT_EQ(control("auto_exposure").value, "3: Aperture Priority Mode");
    EXPECT_THAT(control("auto_exposure").choices,
                ElementsAre("1: Manual Mode", "3: Aperture Priority Mode"));
    EXPECT_EQ(control("exposure_time_absolute").unit, "100 us");
    EXPECT_EQ(control("gain").low, 3.0);
    EXPECT_EQ(control("gain").value, "20");
    EXPECT_EQ(control("frame_rate").value, "25");
    EXPECT_EQ(control("frame_rate").unit, "Hz");
    EXPECT_THAT(control("frame_rate").choices, ElementsAre("25", "50"));
}

// ---- settings --------------------------------------------------------------------------------

TEST_F(V4l2, BringsEveryAutomaticAndEnhancingFunctionToRest) {
    device_.controls.push_back(
        {V4L2_CID_HFLIP, V4L2_CTRL_TYPE_BOOLEAN, "Horizontal Flip", 0, 1, 1, 1, {}});
    device_.controls.push_back(
        {0x0098f901, V4L2_CTRL_TYPE_INTEGER, "3D Noise Reduction", 0, 9, 1, 4, {}});
    auto camera = open();
    camera->configure(settings_);
    EXPECT_EQ(device_.control("Auto Exposure").value, 1);
    EXPECT_EQ(device_.control("White Balance, Automatic").value, 0);
    EXPECT_EQ(device_.control("Power Line Frequency").value, 0);
    EXPECT_EQ(device_.control("Horizontal Flip").value, 0);
    EXPECT_EQ(device_.control("Sharpness").value, 0);
    EXPECT_EQ(device_.control("3D Noise Reduction").value, 0);
    EXPECT_EQ(device_.control("Gain").value, 3) << "the lowest";
    EXPECT_EQ(device_.control("Brightness").value, 0) << "the driver's default";
    EXPECT_EQ(device_.control("Exposure Time, Absolute").value, 70);
    EXPECT_THAT(camera->remarks(), IsEmpty());
}

TEST_F(V4l2, RemarksWhatCannotBeSwitchedOff) {
    device_.control("Sharpness").stuck = true;
    auto camera = open();
    camera->configure(settings_);
    EXPECT_THAT(camera->remarks(), ElementsAre("sharpness stays at 3: it cannot be set to 0"));
}

TEST_F(V4l2, GivesNoExposureWhileTheAutomaticOneRuns) {
    device_.control("Auto Exposure").stuck = true;
    EXPECT_THAT(configure_error(settings_), HasSubstr("automatic exposure cannot"));
}

TEST_F(V4l2, SetsControlsByNameAfterAllOthers) {
    settings_.controls = {{"sharpness", 2}, {"Gain", 17}};
    auto camera = open();
    const CaptureSettings actual = camera->configure(settings_);
    EXPECT_EQ(actual.controls.at("sharpness"), 2);
    EXPECT_EQ(device_.control("Gain").value, 17);
}

TEST_F(V4l2, RefusesControlsThatAreNotSetAsAsked) {
    const auto error_with = [&](const std::string& name, double value) {
        CaptureSettings settings = settings_;
        settings.controls[name] = value;
        return configure_error(settings);
    };
    EXPECT_THAT(error_with("iris", 1), HasSubstr("no such control"));
    EXPECT_THAT(error_with("gain", 101), HasSubstr("takes 3 to 100"));
    EXPECT_THAT(error_with("gain", 7.5), HasSubstr("whole numbers"));
    EXPECT_THAT(error_with("gain", std::nan("")), HasSubstr("whole numbers"));
    device_.control("Gain").most = 50;
    EXPECT_THAT(error_with("gain", 70), HasSubstr("gain = 50"));
    device_.errors[VIDIOC_S_EXT_CTRLS] = EIO;
    EXPECT_THAT(error_with("gain", 70), HasSubstr("EIO"));
}

TEST_F(V4l2, SetsTheFrameRateAndSetsItAgainWhenTheDeviceReturns) {
    settings_.controls["frame_rate"] = 50;
    auto camera = open();
    EXPECT_EQ(camera->configure(settings_).controls.at("frame_rate"), 50);
    EXPECT_EQ(device_.period, 20ms);
    device_.unplug();
    device_.plug_in("/dev/video0");
    EXPECT_EQ(device_.period, 40ms);
    camera->reconnect(clock_.now() + 1s, {});
    EXPECT_EQ(device_.period, 20ms);
}

TEST_F(V4l2, RefusesAFrameRateThatIsNotSetAsAsked) {
    const auto error_with = [&](double hz) {
        CaptureSettings settings = settings_;
        settings.controls["frame_rate"] = hz;
        return configure_error(settings);
    };
    EXPECT_THAT(error_with(30),
                AllOf(HasSubstr("set frame_rate to 30"), HasSubstr("the device uses 25")));
    EXPECT_THAT(error_with(0), HasSubstr("no frame rate"));
    EXPECT_THAT(error_with(std::nan("")), HasSubstr("no frame rate"));
    device_.sets_period = false;
    EXPECT_THAT(error_with(50), HasSubstr("cannot set it"));
    device_.says_period = false;
    EXPECT_THAT(error_with(50), HasSubstr("set frame_rate to 50"));
}

// A driver that counts in whole microseconds.
TEST_F(V4l2, TakesARoundedPeriodForTheFrameRateThatWasAsked) {
    device_.frame_rates = {30};
    settings_.controls["frame_rate"] = 30;
    EXPECT_EQ(open()->configure(settings_).controls.at("frame_rate"), 30);
}

TEST_F(V4l2, RoundsTheExposureToTheStepsOf100Microseconds) {
    settings_.exposure = 7049us;
    EXPECT_EQ(open()->configure(settings_).exposure, 7000us);
    device_.control("Exposure Time, Absolute").most = 60;
    EXPECT_THAT(configure_error(settings_), HasSubstr("7049 us"));
}

TEST_F(V4l2, FailsWhenTheDriverCorrectsTheImageFormat) {
    device_.width_limit = 16;
    EXPECT_THAT(configure_error(settings_), HasSubstr("GREY with 16x11"));
    device_.width_limit = 17;
    device_.interlaced = true;
    EXPECT_THAT(configure_error(settings_), HasSubstr("interlaced"));
}

TEST_F(V4l2, ChoosesAMonochromeFormatThatHoldsTheBits) {
    const auto format_for = [&](int bits, std::vector<std::string> offered) {
        device_.formats = std::move(offered);
        settings_.bits = bits;
        return open()->configure(settings_).format;
    };
    EXPECT_EQ(format_for(8, {"MJPG", "YUYV", "RGGB", "GREY"}), "GREY");
    EXPECT_EQ(format_for(8, {"MJPG", "YUYV"}), "YUYV");
    EXPECT_EQ(format_for(12, {"GREY", "Y16 ", "Y12P"}), "Y12P");
    EXPECT_EQ(format_for(12, {"GREY", "Y10 ", "Y16 "}), "Y16");
    EXPECT_EQ(format_for(0, {"MJPG", "Y10 "}), "Y10");
    EXPECT_THROW(format_for(8, {"MJPG", "RGGB"}), DeviceError);
    EXPECT_THROW(format_for(12, {"GREY", "Y10 "}), DeviceError);
}

TEST_F(V4l2, TakesAMosaicAndACompressedFormatByTheirNames) {
    device_.formats = {"MJPG", "BA81"};
    settings_.format = "BA81";
    auto camera = armed();
    EXPECT_EQ(frame(*camera).mosaic, Mosaic::bggr);
    camera.reset();

    std::vector<std::uint8_t> jpeg;
    cv::imencode(".jpg", cv::Mat(11, 17, CV_8UC1, cv::Scalar(99)), jpeg);
    device_.picture = [=](Instant) { return jpeg; };
    device_.spoil = [=](FakeV4l2Frame& frame) { frame.bytes_used = jpeg.size(); };
    settings_.format = "MJPG";
    camera = armed();
    const Frame decoded = frame(*camera);
    ASSERT_EQ(decoded.status, FrameStatus::complete) << decoded.status_detail;
    EXPECT_NEAR(cv::mean(decoded.image.pixels)[0], 99.0, 2.0);
    EXPECT_THAT(camera->remarks(), Contains(HasSubstr("MJPG is lossy")));
}

// ---- streams that do not start ---------------------------------------------------------------

TEST_F(V4l2, SaysWhyAStreamDoesNotStartAndGivesEverythingBack) {
    auto camera = open();
    camera->configure(settings_);
    const auto arm = [&] { camera->arm(); };
    device_.errors[VIDIOC_STREAMON] = EBUSY;
    EXPECT_THAT(device_error_of(arm), HasSubstr("another program uses the device"));
    device_.errors = {{VIDIOC_REQBUFS, ENOMEM}};
    EXPECT_THAT(device_error_of(arm), HasSubstr("ENOMEM"));
    device_.errors.clear();
    device_.most_buffers = 1;
    EXPECT_THAT(device_error_of(arm), HasSubstr("the driver gives 1"));
    device_.most_buffers = 4;
    device_.refuses_to_map = true;
    EXPECT_THAT(device_error_of(arm), HasSubstr("map a buffer"));
    device_.refuses_to_map = false;
    EXPECT_EQ(device_.mapped, 0);
    camera->arm();
    EXPECT_EQ(device_.mapped, 4);
    EXPECT_EQ(frame(*camera).status, FrameStatus::complete);
    camera.reset();
    EXPECT_EQ(device_.mapped, 0);
    EXPECT_EQ(device_.open_files(), 0);
}

// ---- the driver's other answers --------------------------------------------------------------

TEST_F(V4l2, AsksAgainAfterASignalAndWhenThereIsNothingYet) {
    auto camera = armed();
    device_.dequeue_errors = {EINTR, EINTR, EAGAIN, EAGAIN, EAGAIN};
    EXPECT_EQ(frame(*camera).status, FrameStatus::complete);
    EXPECT_TRUE(device_.dequeue_errors.empty());
}

TEST_F(V4l2, EndsInTimeWhenTheDriverAnnouncesFramesAndHasNone) {
    auto camera = armed();
    device_.dequeue_errors.assign(100000, EAGAIN);
    const Instant before = clock_.now();
    EXPECT_EQ(frame(*camera).status, FrameStatus::timed_out);
    EXPECT_LT(clock_.now() - before, 1400ms);
    EXPECT_GT(device_.dequeue_errors.size(), 90000u) << "without a pause";
}

TEST_F(V4l2, FailsOnAnErrorOfTheDevice) {
    auto camera = armed();
    device_.dequeue_errors = {EIO};
    EXPECT_THAT(device_error_of([&] { frame(*camera); }), HasSubstr("EIO"));
}

TEST_F(V4l2, FailsWhenItIsPulledAtAnyRequest) {
    // Counts the requests of a whole use, then pulls the device at each of them.
    const auto use = [&] {
        auto camera = armed();
        frame(*camera);
        camera->disarm();
    };
    int requests = 0;
    device_.on_ioctl = [&](unsigned long) { ++requests; };
    use();
    const int all = requests;
    ASSERT_GT(all, 50);
    for (int last = 0; last < all; last += 3) {
        requests = 0;
        device_.on_ioctl = [&](unsigned long request) {
            const bool ending = request == VIDIOC_STREAMOFF || request == VIDIOC_REQBUFS;
            if (requests++ == last && !ending)
                device_.unplug();
        };
        const bool unnoticed = device_error_of(use) == "no error";
        EXPECT_TRUE(!unnoticed || requests >= all - 2) << "pulled at " << last;
        device_.plug_in("/dev/video0");
        EXPECT_EQ(device_.open_files(), 0);
        EXPECT_EQ(device_.mapped, 0);
    }
}

TEST_F(V4l2, NoticesAStopRequestWithin20Milliseconds) {
    std::stop_source stop;
    auto camera = armed();
    device_.spoil = [](FakeV4l2Frame& frame) { frame.done += 1h; };
    const Instant asked = clock_.now() + 300ms;
    device_.on_ioctl = [&](unsigned long) {
        if (clock_.now() >= asked)
            stop.request_stop();
    };
    EXPECT_THROW(camera->frame_after(clock_.now(), 3, stop.get_token()), Interrupted);
    EXPECT_LE(clock_.now() - asked, 20ms);
}

TEST_F(V4l2, IsLeftAloneWhenItsDriverHangs) {
    std::latch released(1);
    auto camera = armed();
    device_.on_ioctl = [&](unsigned long request) {
        if (request == VIDIOC_STREAMOFF)
            released.wait();
    };
    const auto before = std::chrono::steady_clock::now();
    camera->disarm();
    EXPECT_LT(std::chrono::steady_clock::now() - before, 1500ms);
    EXPECT_THAT(device_error_of([&] { camera->arm(); }), HasSubstr("gone"));
    released.count_down();
    while (device_.mapped > 0)
        std::this_thread::yield();  // until what was left alone has ended
}

// ---- coming back -----------------------------------------------------------------------------

TEST_F(V4l2, ComesBackAtAnotherNodeWithEverySettingAppliedAgain) {
    settings_.controls["contrast"] = 41;
    auto camera = armed();
    device_.unplug();
    EXPECT_THROW(frame(*camera), DeviceError);
    device_.plug_in("/dev/video3");
    EXPECT_EQ(device_.control("Auto Exposure").value, 3) << "as after power-up";
    camera->reconnect(clock_.now() + 1s, {});
    EXPECT_EQ(device_.control("Auto Exposure").value, 1);
    EXPECT_EQ(device_.control("Exposure Time, Absolute").value, 70);
    EXPECT_EQ(device_.control("Contrast").value, 41);
    EXPECT_EQ(device_.width, 17);
    EXPECT_EQ(frame(*camera).status, FrameStatus::complete);
}

TEST_F(V4l2, TakesNoOtherDeviceForItself) {
    auto camera = armed();
    device_.unplug();
    EXPECT_THROW(frame(*camera), DeviceError);
    device_.serial = "FAKE-8";
    device_.plug_in("/dev/video0");
    EXPECT_THROW(camera->reconnect(clock_.now() + 1s, {}), DeviceError);
    EXPECT_THROW(frame(*camera), DeviceError) << "still lost";
    device_.serial = "FAKE-7";
    device_.control("Exposure Time, Absolute").most = 60;
    EXPECT_THROW(camera->reconnect(clock_.now() + 1s, {}), DeviceError) << "other settings";
    EXPECT_THROW(frame(*camera), DeviceError) << "still lost";
    device_.control("Exposure Time, Absolute").most.reset();
    camera->reconnect(clock_.now() + 1s, {});
    EXPECT_EQ(frame(*camera).status, FrameStatus::complete);
    EXPECT_EQ(camera->statistics().reconnects, 1);
}

}  // namespace
}  // namespace etalon
