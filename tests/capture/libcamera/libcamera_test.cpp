#include "capture/libcamera/libcamera_camera.h"
#include "tests/capture/frame/camera_contract.h"
#include "tests/capture/libcamera/fake_libcamera.h"

namespace etalon {
namespace {

using testing::UnorderedElementsAre;

// ---- formats -------------------------------------------------------------------------------

std::vector<LibcameraFormat> offering(std::initializer_list<const char*> names) {
    std::vector<LibcameraFormat> formats;
    for (const char* name : names)
        formats.push_back({name, {{{640, 480}, {640, 480}}}});
    return formats;
}

std::string chosen(int bits, const std::string& format, const std::vector<LibcameraFormat>& from) {
    const PixelFormat* row = choose_libcamera_format({.bits = bits, .format = format}, from);
    return row ? std::string(row->libcamera) : "none";
}

TEST(LibcameraFormats, AreChosenByNameOrAsTheMonochromeOneThatHoldsTheBits) {
    const auto all =
        offering({"SRGGB10", "MJPEG", "R12", "YUYV", "R8", "R10_CSI2P", "R16", "SRGGB8"});
    EXPECT_EQ(chosen(8, "", offering({"SRGGB8", "MJPEG", "YUYV"})), "YUYV");
    EXPECT_EQ(chosen(10, "", all), "R10_CSI2P");
    EXPECT_EQ(chosen(11, "", all), "R12");
    EXPECT_EQ(chosen(16, "", all), "R16");
    EXPECT_EQ(chosen(10, "SRGGB10", all), "SRGGB10");
    EXPECT_EQ(chosen(0, "R12", all), "R12");
    EXPECT_EQ(chosen(7, "", offering({"R8", "R10"})), "R8");
}

TEST(LibcameraFormats, AreNotChosenWhereTheyDoNotHoldTheBitsOrAreUnknown) {
    EXPECT_EQ(chosen(12, "", offering({"R8", "R10"})), "none");
    EXPECT_EQ(chosen(8, "", offering({"R10", "SRGGB8"})), "none");  // 16-bit; a mosaic
    EXPECT_EQ(chosen(12, "R10", offering({"R10"})), "none");
    EXPECT_EQ(chosen(8, "R8", offering({"YUYV"})), "none");
    EXPECT_EQ(chosen(8, "", offering({"XRGB8888"})), "none");
}

TEST(LibcameraFormats, SayWhatTheDriverAdjusted) {
    LibcameraStream stream{"R8", {640, 480}, 640, false};
    EXPECT_FALSE(stream_difference("R8", {640, 480}, stream));
    EXPECT_FALSE(stream_difference("R8", {}, stream));
    EXPECT_EQ(stream_difference("R10", {}, stream)->cause, "libcamera adjusts it to R8");
    EXPECT_EQ(stream_difference("R8", {640, 400}, stream)->request, "set image size 640x400");
    EXPECT_EQ(stream_difference("R8", {600, 480}, stream)->cause,
              "libcamera adjusts it to 640x480");
}

// ---- controls ------------------------------------------------------------------------------

TEST(LibcameraControls, AreAskedToDoNothingByThemselves) {
    const auto [plan, difference] = plan_libcamera_controls({}, {{"AeEnable", {0, 1, 1}},
                                                                 {"ExposureTimeMode", {0, 1, 0}},
                                                                 {"Sharpness", {0, 16, 1}},
                                                                 {"Contrast", {0, 32, 1.5}},
                                                                 {"Lux", {0, 9, 1}}});
    EXPECT_FALSE(difference);
    EXPECT_EQ(plan.automatics,
              (LibcameraValues{
                  {"AeEnable", 0}, {"ExposureTimeMode", 1}, {"Sharpness", 0}, {"Contrast", 1}}));
    EXPECT_THAT(plan.asked, IsEmpty());
    EXPECT_THAT(plan.remarks, IsEmpty());
}

TEST(LibcameraControls, RemarkOnWhatCannotBeSwitchedOff) {
    const auto planning = plan_libcamera_controls({}, {{"Sharpness", {3, 16, 5}}});
    EXPECT_EQ(planning.plan.automatics.at("Sharpness"), 3);
    EXPECT_THAT(planning.plan.remarks,
                ElementsAre("Sharpness stays at 3: it cannot be switched off"));
}

TEST(LibcameraControls, HaveLibcamerasUnits) {
    const CaptureSettings wanted{
        .exposure = 5000us, .gain_db = 20.0, .controls = {{"Contrast", 1.5}}};
    const auto [plan, difference] =
        plan_libcamera_controls(wanted, {{"ExposureTime", {100, 66000, 1000}},
                                         {"AnalogueGain", {1, 16, 1}},
                                         {"Contrast", {0, 32, 1}}});
    EXPECT_FALSE(difference);
    EXPECT_EQ(plan.asked.at("ExposureTime"), 5000);
    EXPECT_NEAR(plan.asked.at("AnalogueGain"), 10.0, 1e-12);
    EXPECT_EQ(plan.asked.at("Contrast"), 1.5);
    EXPECT_THAT(plan.automatics, IsEmpty());
}

TEST(LibcameraControls, AreRefusedOutsideTheirRangeOrWhereThereAreNone) {
    CaptureSettings wanted{.exposure = 7us};
    auto difference =
        plan_libcamera_controls(wanted, {{"ExposureTime", {100, 66000, 1000}}}).difference;
    EXPECT_EQ(difference->request, "set exposure 7 us");
    EXPECT_EQ(difference->cause, "possible are exposure 100 us to exposure 66000 us");
    wanted.exposure = 0us;
    wanted.gain_db = 5.0;
    difference = plan_libcamera_controls(wanted, {}).difference;
    EXPECT_EQ(difference->cause, "the camera has no control AnalogueGain");
    wanted.gain_db = 0.0;
    EXPECT_FALSE(plan_libcamera_controls(wanted, {}).difference);
}

TEST(LibcameraControls, AreContradictedByMetadataBeyondTheirStep) {
    const LibcameraValues asked{{"ExposureTime", 5000}};
    EXPECT_FALSE(contradicted(asked, {{"ExposureTime", 4981}}, 20.0));
    EXPECT_EQ(contradicted(asked, {{"ExposureTime", 4979}}, 20.0)->cause,
              "the frames say exposure 4979 us");
    EXPECT_FALSE(contradicted(asked, {{"AnalogueGain", 2}}, 20.0));
    EXPECT_TRUE(contradicted({{"AnalogueGain", 2}}, {{"AnalogueGain", 2.02}}, 20.0));
    EXPECT_FALSE(contradicted({{"AnalogueGain", 2}}, {{"AnalogueGain", 2.01}}, 20.0));
    EXPECT_TRUE(contradicted({{"AeEnable", 0}}, {{"AeEnable", 1}}, 20.0));
}

// ---- time ----------------------------------------------------------------------------------

constexpr std::int64_t second = 1'000'000'000;

TEST(SensorClock, TakesAStampForEitherClockWhereTheMachineNeverSlept) {
    SensorClock clock;
    const auto stamped = clock.age(100 * second, {107 * second, 107 * second + 40});
    EXPECT_EQ(stamped.age, 7s);
    EXPECT_EQ(stamped.uncertainty, 40ns);
}

TEST(SensorClock, TellsTheClocksApartWhereItSlept) {
    const KernelTime now{1000 * second, 1500 * second};
    SensorClock monotonic, boot;
    EXPECT_EQ(monotonic.age(993 * second, now).age, 7s);
    EXPECT_EQ(boot.age(1493 * second, now).age, 7s);
    EXPECT_EQ(boot.age(1493 * second, now).uncertainty, 0s);
    EXPECT_EQ(boot.age(995 * second, now).age, 505s) << "it forgot";
}

LibcameraFrame stamped(std::uint64_t sequence, std::int64_t stamp_ns, LibcameraValues metadata) {
    LibcameraFrame frame;
    frame.sequence = sequence;
    frame.timestamp_ns = stamp_ns;
    frame.metadata = std::move(metadata);
    return frame;
}

constexpr KernelTime at(std::int64_t ns) {
    return {ns, ns};
}

TEST(FrameTiming, TakesAStampForTheReadoutOfTheFirstLine) {
    FrameTiming timing;
    const Instant now = Instant(700s);
    const auto start =
        timing.place(stamped(7, 100 * second, {{"ExposureTime", 5000}}), at(101 * second), now);
    EXPECT_EQ(start.fault, "");
    EXPECT_EQ(start.latest, now - 1s);
    EXPECT_EQ(start.earliest, now - 1s - 5ms);
}

TEST(FrameTiming, LooksAtTheFourthFrameBeforeWhereTheExposureIsUnknown) {
    FrameTiming timing;
    const Instant now = Instant(700s);
    const auto width = [&](std::uint64_t sequence, std::int64_t ms) {
        const auto start = timing.place(stamped(sequence, 100 * second + ms * 1'000'000, {}),
                                        at(101 * second), now);
        return start.earliest == Instant::min() ? Duration::max() : start.latest - start.earliest;
    };
    EXPECT_EQ(width(7, 0), Duration::max());
    EXPECT_EQ(width(8, 33), Duration::max());
    EXPECT_EQ(width(9, 70), Duration::max());
    EXPECT_EQ(width(10, 99), Duration::max());
    EXPECT_EQ(width(11, 140), 140ms);
    EXPECT_EQ(width(12, 160), 127ms);
    EXPECT_EQ(width(15, 320), 180ms) << "between them were some that nobody received";
    EXPECT_EQ(timing.period(), 40ms);
}

TEST(FrameTiming, BelievesNoStampThatJumpsOrIsMissing) {
    FrameTiming timing;
    timing.place(stamped(7, 100 * second, {}), at(101 * second), {});
    EXPECT_THAT(timing.place(stamped(8, 97 * second, {}), at(101 * second), {}).fault,
                HasSubstr("before the frame that came before it"));
    EXPECT_EQ(timing.place(stamped(9, 98 * second, {}), at(101 * second), {}).fault, "");
    EXPECT_THAT(timing.place(stamped(10, 105 * second, {}), at(101 * second), {}).fault,
                HasSubstr("in the future"));
    LibcameraFrame without;
    EXPECT_THAT(timing.place(without, at(101 * second), {}).fault, HasSubstr("SensorTimestamp"));
}

// ---- the camera ----------------------------------------------------------------------------

CodeImage flat(cv::Size size, int bits, int code) {
    return {cv::Mat(size, bits <= 8 ? CV_8UC1 : CV_16UC1, cv::Scalar(code)), bits};
}

// An image sensor whose frames say what they were taken with.
void make_sensor(LibcameraWorld& world) {
    world.formats = {{"R12", {{{8, 6}, {64, 48}, {2, 2}}}}, {"SRGGB10", {{{64, 48}, {64, 48}}}}};
    world.controls = {{"AeEnable", {0, 1, 1}},
                      {"ExposureTime", {100, 15000, 8000}},
                      {"AnalogueGain", {1, 16, 1.5}},
                      {"Sharpness", {0, 16, 1}}};
    world.mentioned = {"AeEnable", "ExposureTime", "AnalogueGain"};
    world.scene = [](Instant) { return flat({64, 48}, 12, 1234); };
}

// A USB camera, whose frames say nothing.
void make_usb(LibcameraWorld& world) {
    world.formats = {{"YUYV", {{{64, 48}, {64, 48}}}}};
    world.controls = {{"AnalogueGain", {0.5, 4, 1}}, {"ExposureTime", {100, 15000, 8000}}};
    world.mentioned = {};
    world.scene = [](Instant) { return flat({64, 48}, 8, 77); };
}

std::unique_ptr<Camera> open_fake(LibcameraWorld& world) {
    return open_libcamera_camera("fake", {}, world.clock, [&](const std::string&) {
        return std::make_unique<FakeLibcamera>(world);
    });
}

class LibcameraCameraTest : public testing::Test {
protected:
    LibcameraCameraTest() { make_sensor(world_); }

    std::unique_ptr<Camera> open() { return open_fake(world_); }
    std::unique_ptr<Camera> armed() {
        auto camera = open();
        camera->configure(wanted_);
        camera->arm();
        return camera;
    }
    std::string refusal() {
        return device_error_of([&] { open()->configure(wanted_); });
    }

    LibcameraWorld world_;
    CaptureSettings wanted_{.bits = 12, .exposure = 5000us, .gain_db = 6.0};
};

TEST_F(LibcameraCameraTest, WaitsUntilTheFramesSayWhatWasAskedFor) {
    world_.delay = 9;
    auto camera = open();
    const CaptureSettings actual = camera->configure(wanted_);
    EXPECT_EQ(actual.exposure, 5000us);
    EXPECT_NEAR(actual.gain_db, 6.0, 1e-6);
    camera->arm();
    const Frame frame = camera->frame_after(world_.clock.now(), 0, {});
    EXPECT_EQ(frame.settings.exposure, 5000us);
    EXPECT_EQ(frame.image.pixels.at<std::uint16_t>(5, 7), 1234);
    EXPECT_EQ(frame.time_source, TimeSource::driver_start);
}

TEST_F(LibcameraCameraTest, RefusesAnExposureThatTheFramesNeverSay) {
    world_.stuck = {{"ExposureTime", 8000}};
    EXPECT_THAT(refusal(), HasSubstr("set exposure 5000 us: the frames say exposure 8000 us"));
    world_.stuck.clear();
    world_.mentioned = {"AnalogueGain"};
    EXPECT_THAT(refusal(), HasSubstr("set exposure 5000 us: the frames' metadata do not mention"));
}

TEST_F(LibcameraCameraTest, FailsWhenTheCameraChangesItsExposure) {
    auto camera = armed();
    camera->frame_after(world_.clock.now(), 0, {});
    world_.stuck = {{"ExposureTime", 8000}};
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 5, {}), DeviceError);
}

TEST_F(LibcameraCameraTest, RemarksOnWhatGoesOnByItselfOrIsNotReadBack) {
    world_.stuck = {{"AeEnable", 1}};
    auto camera = open();
    camera->configure(wanted_);
    EXPECT_THAT(camera->remarks(),
                UnorderedElementsAre("AeEnable 1 stays: it cannot be switched off",
                                     HasSubstr("not read back, since the frames' metadata do not "
                                               "mention it: Sharpness")));
}

TEST_F(LibcameraCameraTest, RejectsAFrameWhoseStampJumpsBack) {
    auto camera = armed();
    int frames = 0;
    world_.spoil = [&](LibcameraFrame& frame, Instant) {
        if (frames++ == 0)
            *frame.timestamp_ns -= 3'600'000'000'000;
    };
    world_.clock.advance(200ms);
    const Frame bad = camera->frame_after(world_.clock.now(), 0, {});
    EXPECT_EQ(bad.status, FrameStatus::corrupt);
    EXPECT_THAT(bad.status_detail, HasSubstr("before the frame that came before it"));
    EXPECT_EQ(camera->frame_after(world_.clock.now(), 0, {}).status, FrameStatus::complete);
}

TEST_F(LibcameraCameraTest, IsNotMisledByAMachineThatSlept) {
    world_.suspended = 1h;
    for (const bool boot_time : {true, false}) {
        world_.stamps_boot_time = boot_time;
        auto camera = armed();
        const Instant t = world_.clock.now();
        const Frame frame = camera->frame_after(t, 0, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        EXPECT_GT(frame.exposure_start, t);
        EXPECT_LT(frame.exposure_start, world_.clock.now());
    }
}

TEST_F(LibcameraCameraTest, SaysThatTheCameraIsGoneWhenRequestsAreCancelled) {
    auto camera = armed();
    world_.spoil = [](LibcameraFrame& frame, Instant) {
        frame.status = LibcameraFrame::Status::cancelled;
    };
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 5, {}), DeviceError);
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 5, {}), DeviceError);
}

TEST_F(LibcameraCameraTest, SaysAtOnceThatTheCameraWasPulledOutWhileItWaited) {
    auto camera = armed();
    world_.spoil = [&](LibcameraFrame&, Instant) { world_.plugged = false; };
    const Instant before = world_.clock.now();
    EXPECT_THROW(camera->frame_after(before, 0, {}), DeviceError);
    EXPECT_LT(world_.clock.now() - before, 100ms);
}

TEST_F(LibcameraCameraTest, GivesUpOnACameraWhoseFramesAllSeemOld) {
    auto camera = armed();
    world_.spoil = [](LibcameraFrame& frame, Instant begin) {
        *frame.timestamp_ns -= 3'600'000'000'000 - begin.time_since_epoch().count() / 100;
    };
    camera->frame_after(world_.clock.now(), 0, {});  // the jump
    const Frame frame = camera->frame_after(world_.clock.now(), 0, {});
    EXPECT_EQ(frame.status, FrameStatus::timed_out);
    EXPECT_THAT(frame.status_detail, HasSubstr("none of them begun after"));
}

TEST_F(LibcameraCameraTest, CountsFramesThatWereLostWhileItWaitedButNoneBefore) {
    make_usb(world_);  // of which it takes five to find a fresh one
    wanted_ = {};
    auto camera = armed();
    camera->frame_after(world_.clock.now(), 0, {});
    world_.clock.advance(1s);
    camera->frame_after(world_.clock.now(), 0, {});
    EXPECT_EQ(camera->statistics().skipped, 0);
    const Instant t = world_.clock.now();
    world_.loses = [t](Instant begin) { return begin > t + 20ms && begin < t + 80ms; };
    EXPECT_EQ(camera->frame_after(t, 0, {}).status, FrameStatus::complete);
    EXPECT_EQ(camera->statistics().skipped, 3);
}

TEST_F(LibcameraCameraTest, OutlastsACameraThatFreezesForFiveSeconds) {
    auto camera = armed();
    world_.frozen_until = world_.clock.now() + 5s;
    EXPECT_EQ(camera->frame_after(world_.clock.now(), 3, {}).status, FrameStatus::timed_out);
    EXPECT_EQ(camera->frame_after(world_.clock.now(), 3, {}).status, FrameStatus::complete);
}

// Without udev nobody announces that a camera was pulled out: it just falls silent.
TEST_F(LibcameraCameraTest, FindsOutThatASilentCameraIsGone) {
    world_.announces_unplugging = false;
    auto camera = armed();
    world_.plugged = false;
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 0, {}), DeviceError);
    const Instant before = world_.clock.now();
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 0, {}), DeviceError);
    EXPECT_EQ(world_.clock.now(), before) << "it waited for a camera that it knew was gone";
}

TEST_F(LibcameraCameraTest, DoesNotTakeAnotherModelForTheOneThatWentAway) {
    auto camera = armed();
    world_.plugged = false;
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 0, {}), DeviceError);
    world_.plugged = true;
    world_.model = "Another one";
    EXPECT_THROW(camera->reconnect(world_.clock.now() + 1s, {}), DeviceError);
    world_.model = "Fake sensor";
    camera->reconnect(world_.clock.now() + 1s, {});
    EXPECT_EQ(camera->frame_after(world_.clock.now(), 0, {}).settings.exposure, 5000us);
}

TEST_F(LibcameraCameraTest, ComesBackDisarmedIfItWasDisarmed) {
    auto camera = armed();
    world_.plugged = false;
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 0, {}), DeviceError);
    camera->disarm();
    world_.plugged = true;
    camera->reconnect(world_.clock.now() + 1s, {});
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 0, {}), DeviceError);
    camera->arm();
    EXPECT_EQ(camera->frame_after(world_.clock.now(), 0, {}).status, FrameStatus::complete);
}

TEST_F(LibcameraCameraTest, RefusesCodesThatHaveMoreBitsThanWasSaid) {
    world_.scene = [](Instant) { return flat({64, 48}, 12, 1234); };
    wanted_.bits = 10;
    auto camera = armed();
    EXPECT_THROW(camera->frame_after(world_.clock.now(), 0, {}), DeviceError);
}

TEST_F(LibcameraCameraTest, KeepsTheMosaicOfAColourSensor) {
    world_.scene = [](Instant) { return flat({64, 48}, 10, 777); };
    wanted_.format = "SRGGB10";
    wanted_.bits = 0;
    auto camera = armed();
    const Frame frame = camera->frame_after(world_.clock.now(), 0, {});
    EXPECT_EQ(frame.mosaic, Mosaic::rggb);
    EXPECT_EQ(frame.image.bits, 10);
    EXPECT_EQ(frame.image.pixels.at<std::uint16_t>(5, 7), 777);
}

TEST_F(LibcameraCameraTest, RemarksOnWhatAUsbCameraMayDoUnasked) {
    make_usb(world_);
    wanted_ = {};
    auto camera = open();
    EXPECT_EQ(camera->configure(wanted_).exposure, 0us);
    EXPECT_THAT(camera->remarks(),
                Contains(HasSubstr("luma is kept, which the camera made, from 16 to 235")));
    EXPECT_THAT(camera->remarks(), Contains(HasSubstr("AnalogueGain")));
    EXPECT_THAT(camera->remarks(), Contains(HasSubstr("sharpening of a USB camera")));
}

// ---- the contract --------------------------------------------------------------------------

class LibcameraRig final : public CameraRig {
public:
    explicit LibcameraRig(bool usb) : usb_(usb) {
        usb ? make_usb(world_) : make_sensor(world_);
        world_.scene = [this](Instant begin) { return scene_at(begin); };
    }

    Clock& clock() override { return world_.clock; }
    std::unique_ptr<Camera> open() override { return open_fake(world_); }

    CaptureSettings settings() const override {
        return {.width = 64,
                .height = 48,
                .bits = usb_ ? 8 : 12,
                .exposure = usb_ ? 0us : 5000us,
                .gain_db = usb_ ? 0.0 : 6.0};
    }

    std::vector<Refusal> refusals() const override {
        std::vector<Refusal> refusals{
            {"66x48", [](CaptureSettings& s) { s.width = 66; }},
            {"16 bits", [](CaptureSettings& s) { s.bits = 16; }},
            {"NV99", [](CaptureSettings& s) { s.format = "NV99"; }},
            {"Line1", [](CaptureSettings& s) { s.trigger = "Line1"; }},
            {"black level", [](CaptureSettings& s) { s.black_level = 7.0; }},
            {"exposure 70 us", [](CaptureSettings& s) { s.exposure = 70us; }},
            {"gain 90 dB", [](CaptureSettings& s) { s.gain_db = 90.0; }},
            {"Sepia", [](CaptureSettings& s) { s.controls["Sepia"] = 1.0; }}};
        if (usb_)
            refusals.push_back({"ExposureTime", [](CaptureSettings& s) { s.exposure = 5000us; }});
        return refusals;
    }

    bool show(const CodeImage& scene) override {
        scenes_[world_.clock.now()] = scene;
        return true;
    }

    std::optional<FrameStatus> spoil(FrameFault fault, int frames) override {
        if (fault == FrameFault::lost)
            return std::nullopt;  // the next one simply takes its place
        if (fault == FrameFault::late) {
            world_.frozen_until = world_.clock.now() + frames * 1500ms;
            return FrameStatus::timed_out;
        }
        // Nobody misses one that may have begun too early: a USB camera's may have
        // by 100 ms less what its exposure really takes.
        const Instant since = world_.clock.now() + (usb_ ? 93ms : 0ms);
        world_.spoil = [fault, frames, since](LibcameraFrame& frame, Instant begin) mutable {
            if (begin <= since || --frames < 0)
                return;
            if (fault == FrameFault::damaged)
                frame.status = LibcameraFrame::Status::error;
            else
                frame.data = frame.data.first(frame.data.size() - 7 * 13);
        };
        return fault == FrameFault::damaged ? FrameStatus::corrupt : FrameStatus::short_frame;
    }

    bool unplug() override {
        world_.plugged = false;
        return true;
    }
    bool plug_in() override {
        world_.plugged = true;
        return true;
    }

private:
    CodeImage scene_at(Instant begin) const {
        const auto later = scenes_.upper_bound(begin);
        return later == scenes_.begin() ? flat({64, 48}, usb_ ? 8 : 12, 33)
                                        : std::prev(later)->second;
    }

    bool usb_;
    LibcameraWorld world_;
    std::map<Instant, CodeImage> scenes_;
};

INSTANTIATE_TEST_SUITE_P(
    Libcamera, CameraContract,
    testing::Values(
        CameraRigMaker{"LibcameraSensor", [] { return std::make_unique<LibcameraRig>(false); }},
        CameraRigMaker{"LibcameraUsb", [] { return std::make_unique<LibcameraRig>(true); }}),
    rig_name);

// ---- the real library ----------------------------------------------------------------------

TEST(Libcamera, SaysThatThereIsNoSuchCamera) {
    SteadyClock clock;
    for (int i = 0; i < 2; ++i)  // its one manager comes and goes
        try {
            open_camera("libcamera:nobody", {}, clock);
            FAIL() << "it was opened";
        } catch (const ConfigError& left_out) {
            GTEST_SKIP() << left_out.what();
        } catch (const DeviceError& error) {
            EXPECT_THAT(error.what(), HasSubstr("camera libcamera:nobody: open: no such camera"));
        }
}

}  // namespace
}  // namespace etalon
