// What the V4L2 backend makes of devices that misbehave, over a scripted one
// (mocks/camera/fake_v4l2.h). The contract that all backends keep is tested in
// v4l2_contract_test.cpp.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/videodev2.h>

#include <cerrno>
#include <latch>
#include <opencv2/imgcodecs.hpp>

#include "capture/v4l2/v4l2_camera.h"
#include "capture/v4l2/v4l2_controls.h"
#include "capture/v4l2/v4l2_timing.h"
#include "core/errors.h"
#include "mocks/camera/fake_v4l2.h"

namespace etalon {
namespace {

using namespace std::chrono_literals;
using testing::AllOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class V4l2 : public testing::Test {
protected:
    V4l2() {
        clock_.advance(1h);
        settings_.width = 17;
        settings_.height = 11;
        settings_.exposure = 7000us;
    }

    std::unique_ptr<Camera> open() { return open_v4l2_camera("/dev/video0", {}, clock_, device_); }

    std::unique_ptr<Camera> armed() {
        auto camera = open();
        camera->configure(settings_);
        camera->arm();
        return camera;
    }

    Frame frame(Camera& camera, int retries = 0) {
        return camera.frame_after(clock_.now(), retries, {});
    }

    // What the DeviceError says that `call` must throw.
    template <class Call>
    static std::string error_of(const Call& call) {
        try {
            call();
        } catch (const DeviceError& error) {
            return error.what();
        }
        return "no error";
    }

    std::string configure_error(const CaptureSettings& settings) {
        return error_of([&] { open()->configure(settings); });
    }

    // From the next frame that surely counts as new on, as this does.
    void spoil_from_now(std::function<void(FakeV4l2Frame&)> spoil) {
        const Instant from = clock_.now() + 3 * device_.period - device_.readout;
        device_.spoil = [=](FakeV4l2Frame& frame) {
            if (frame.exposure_start > from)
                spoil(frame);
        };
    }

    VirtualClock clock_;
    FakeV4l2 device_{clock_};
    CaptureSettings settings_;
};

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
    EXPECT_THAT(error_of([&] { open(); }), HasSubstr("captures no video"));
    EXPECT_THAT(list_v4l2_cameras(device_), IsEmpty());
    device_.captures = true;
    device_.streams = false;
    EXPECT_THAT(error_of([&] { open(); }), HasSubstr("cannot stream"));
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
    EXPECT_THAT(error_of([&] { open(); }), HasSubstr("group \"video\""));
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
    EXPECT_THAT(error_of(arm), HasSubstr("another program uses the device"));
    device_.errors = {{VIDIOC_REQBUFS, ENOMEM}};
    EXPECT_THAT(error_of(arm), HasSubstr("ENOMEM"));
    device_.errors.clear();
    device_.most_buffers = 1;
    EXPECT_THAT(error_of(arm), HasSubstr("the driver gives 1"));
    device_.most_buffers = 4;
    device_.refuses_to_map = true;
    EXPECT_THAT(error_of(arm), HasSubstr("map a buffer"));
    device_.refuses_to_map = false;
    EXPECT_EQ(device_.mapped, 0);
    camera->arm();
    EXPECT_EQ(device_.mapped, 4);
    EXPECT_EQ(frame(*camera).status, FrameStatus::complete);
    camera.reset();
    EXPECT_EQ(device_.mapped, 0);
    EXPECT_EQ(device_.open_files(), 0);
}

// ---- frames ----------------------------------------------------------------------------------

TEST_F(V4l2, KnowsWhenTheExposureBeganFromTheDriversStamp) {
    struct Case {
        FakeV4l2::Stamps stamps;
        std::string driver;
        Duration uncertainty;
        TimeSource source;
    };
    // At the end of a frame, the exposure of 7 ms had ended 0 to 40 ms (one period) ago; of a USB
    // camera it had begun 7 to 160 ms ago.
    for (const Case& one :
         {Case{FakeV4l2::Stamps::frame_end, "sensor", 20ms, TimeSource::driver_end},
          Case{FakeV4l2::Stamps::frame_end, "uvcvideo", 76500us, TimeSource::driver_end},
          Case{FakeV4l2::Stamps::exposure_start, "uvcvideo", 76500us, TimeSource::driver_start},
          Case{FakeV4l2::Stamps::exposure_start, "sensor", 500us, TimeSource::driver_start}}) {
        device_.stamps = one.stamps;
        device_.driver = one.driver;
        Instant true_start{};
        device_.picture = [&](Instant start) {
            true_start = start;
            return std::vector<std::uint8_t>(17 * 11, 77);
        };
        auto camera = armed();
        const Frame taken = frame(*camera);
        EXPECT_EQ(taken.exposure_start_uncertainty, one.uncertainty);
        EXPECT_EQ(taken.time_source, one.source);
        if (one.stamps == FakeV4l2::Stamps::exposure_start && one.driver == "uvcvideo")
            continue;  // the fake stamps honestly, which that driver is not believed
        EXPECT_LE(taken.exposure_start - taken.exposure_start_uncertainty, true_start);
        EXPECT_GE(taken.exposure_start + taken.exposure_start_uncertainty, true_start);
    }
}

TEST(V4l2Timing, DatesFramesOfAUsbCameraByTheFourthBefore) {
    V4l2Timing timing({.longest_hold = 100ms,
                       .shortest_exposure = 7ms,
                       .longest_exposure = 7ms,
                       .over_usb = true},
                      Instant(1s));
    const auto earliest = [&](std::uint64_t number, std::chrono::milliseconds stamp) {
        FilledBuffer buffer;
        buffer.stamp = stamp;
        buffer.meaning = StampMeaning::exposure_start;
        const Instant now(stamp + 3ms);
        EXPECT_EQ(timing.check(buffer, number, now), "");
        const ExposureStart start = timing.exposure_start(buffer, now);
        EXPECT_EQ(start.latest, Instant(stamp - 7ms));
        return start.earliest;
    };
    EXPECT_EQ(earliest(10, 2000ms), Instant()) << "nothing is known of the first four";
    EXPECT_EQ(earliest(11, 2200ms), Instant());
    EXPECT_EQ(earliest(12, 2410ms), Instant());
    EXPECT_EQ(earliest(13, 2430ms), Instant());
    EXPECT_EQ(earliest(14, 2450ms), Instant(2000ms));
    EXPECT_EQ(earliest(17, 2460ms), Instant(2360ms)) << "almost at once: 100 ms count";
    EXPECT_EQ(earliest(19, 2700ms), Instant(2450ms)) << "frame 15 never came";
}

TEST_F(V4l2, UsesTheArrivalWhereStampsAreOfAnUnknownClock) {
    device_.stamps = FakeV4l2::Stamps::unknown;
    device_.spoil = [](FakeV4l2Frame& frame) { frame.stamp = Instant(3s); };
    auto camera = armed();
    const Frame taken = frame(*camera);
    EXPECT_EQ(taken.status, FrameStatus::complete);
    EXPECT_EQ(taken.time_source, TimeSource::request);
    EXPECT_EQ(taken.device_time_ns, 3'000'000'000u);
    EXPECT_THAT(camera->remarks(), Contains(HasSubstr("unknown clock")));
}

// As the kernel's vivid does: the moment at which the frame would have ended, handed out before.
TEST_F(V4l2, UsesTheArrivalOfFramesThatComeBeforeTheirStamps) {
    device_.spoil = [](FakeV4l2Frame& frame) { frame.stamp += 30ms; };
    auto camera = armed();
    const Instant t = clock_.now();
    const Frame taken = frame(*camera);
    EXPECT_EQ(taken.status, FrameStatus::complete) << taken.status_detail;
    EXPECT_EQ(taken.time_source, TimeSource::request);
    EXPECT_GT(taken.exposure_start - taken.exposure_start_uncertainty, t);
    EXPECT_LE(taken.exposure_start + taken.exposure_start_uncertainty, clock_.now());
}

TEST_F(V4l2, AssumesTheLongestPeriodWhereTheDriverDoesNotSay) {
    device_.says_period = false;
    auto camera = armed();
    EXPECT_EQ(frame(*camera).status, FrameStatus::complete);
    EXPECT_THAT(camera->remarks(), Contains(HasSubstr("1000 ms between frames are assumed")));
}

TEST_F(V4l2, WaitsLongEnoughForLongExposures) {
    settings_.exposure = 204ms;
    CameraLink link;
    link.frame_timeout = 20ms;
    auto camera = open_v4l2_camera("/dev/video0", link, clock_, device_);
    camera->configure(settings_);
    camera->arm();
    for (int i = 0; i < 9; ++i) {
        clock_.advance(i * 31ms);
        EXPECT_EQ(frame(*camera).status, FrameStatus::complete) << i;
    }
}

TEST_F(V4l2, CountsFramesThatNobodyReceived) {
    auto camera = armed();
    frame(*camera);
    const long before = camera->statistics().skipped;
    clock_.advance(400ms);  // 10 frames for 4 buffers, one of them being filled
    const Frame taken = frame(*camera);
    EXPECT_EQ(taken.status, FrameStatus::complete);
    EXPECT_GE(camera->statistics().skipped - before, 5);
    EXPECT_LE(camera->statistics().skipped - before, 7);
}

TEST_F(V4l2, CountsOnWhenTheDriversCounterWraps) {
    device_.spoil = [](FakeV4l2Frame& frame) { frame.sequence += 0xFFFFFFFE; };
    auto camera = armed();
    std::uint64_t last = frame(*camera).id;
    for (int i = 0; i < 5; ++i) {
        const Frame next = frame(*camera);
        EXPECT_GT(next.id, last);
        last = next.id;
    }
    EXPECT_GT(last, 0xFFFFFFFFu);
    EXPECT_LT(camera->statistics().skipped, 10);
}

TEST_F(V4l2, MarksFramesThatTheDriverFlags) {
    auto camera = armed();
    spoil_from_now([](FakeV4l2Frame& frame) { frame.error_flag = true; });
    const Frame taken = frame(*camera, 2);
    EXPECT_EQ(taken.status, FrameStatus::corrupt);
    EXPECT_THAT(taken.status_detail, HasSubstr("flags"));
    EXPECT_GE(camera->statistics().rejected, 3);
}

TEST_F(V4l2, MarksFramesOfAnImpossibleSize) {
    auto camera = armed();
    spoil_from_now([](FakeV4l2Frame& frame) { frame.bytes_used = 186; });
    const Frame cut = frame(*camera);
    EXPECT_EQ(cut.status, FrameStatus::short_frame);
    EXPECT_THAT(cut.status_detail, HasSubstr("186 bytes"));
    spoil_from_now([](FakeV4l2Frame& frame) { frame.bytes_used = 188; });
    const Frame beyond = frame(*camera);
    EXPECT_EQ(beyond.status, FrameStatus::corrupt);
    EXPECT_THAT(beyond.status_detail, HasSubstr("buffer of 187"));
}

TEST_F(V4l2, FailsWhenCodesExceedTheBitsThatWereAsked) {
    device_.formats = {"Y16 "};
    settings_.bits = 10;
    device_.picture = [](Instant) { return std::vector<std::uint8_t>(17 * 11 * 2, 4); };  // 1028
    auto camera = armed();
    EXPECT_THAT(error_of([&] { frame(*camera); }), HasSubstr("above 1023"));
}

TEST_F(V4l2, TrustsNoStampThatLiesInTheFutureOrDoesNotAdvance) {
    auto camera = armed();
    frame(*camera);
    const Instant jump = clock_.now() + device_.period;
    spoil_from_now([](FakeV4l2Frame& frame) { frame.stamp += 1h; });
    const Frame early = frame(*camera);
    EXPECT_EQ(early.status, FrameStatus::corrupt);
    EXPECT_THAT(early.status_detail, HasSubstr("in the future"));
    device_.spoil = [=](FakeV4l2Frame& frame) {
        if (frame.exposure_start > jump + 200ms)
            frame.stamp -= 7min;
    };
    clock_.advance(250ms);
    const Frame late = frame(*camera);
    EXPECT_EQ(late.status, FrameStatus::corrupt);
    EXPECT_THAT(late.status_detail, HasSubstr("before the last frame's"));
}

TEST_F(V4l2, MarksFramesWhoseStampsAreNone) {
    auto camera = armed();
    spoil_from_now([](FakeV4l2Frame& frame) { frame.stamp = Instant(-3s); });
    const Frame taken = frame(*camera);
    EXPECT_EQ(taken.status, FrameStatus::corrupt);
    EXPECT_THAT(taken.status_detail, HasSubstr("time stamp"));
}

// What comes after a jump back is never taken for new; in bounded time that is said.
TEST_F(V4l2, TimesOutWhenTheStampsHaveJumpedBackForGood) {
    auto camera = armed();
    frame(*camera);
    spoil_from_now([](FakeV4l2Frame& frame) { frame.stamp -= 40min; });
    EXPECT_EQ(frame(*camera).status, FrameStatus::corrupt);
    const Instant before = clock_.now();
    const Frame taken = frame(*camera);
    EXPECT_EQ(taken.status, FrameStatus::timed_out);
    EXPECT_THAT(taken.status_detail, HasSubstr("too old"));
    EXPECT_LT(clock_.now() - before, 1400ms);
}

TEST_F(V4l2, OutlastsACameraThatFreezesForFiveSeconds) {
    auto camera = armed();
    frame(*camera);
    const Instant frozen = clock_.now();
    device_.spoil = [=](FakeV4l2Frame& frame) {
        if (frame.exposure_start > frozen)
            frame.done = std::max(frame.done, frozen + 5s);
    };
    EXPECT_EQ(frame(*camera).status, FrameStatus::timed_out);
    EXPECT_LT(clock_.now() - frozen, 1400ms);
    EXPECT_EQ(frame(*camera, 5).status, FrameStatus::complete);
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
    EXPECT_THAT(error_of([&] { frame(*camera); }), HasSubstr("EIO"));
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
        const bool unnoticed = error_of(use) == "no error";
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
    EXPECT_THAT(error_of([&] { camera->arm(); }), HasSubstr("gone"));
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
