// What the GenICam backend does beyond the contract of all cameras: pixel formats, triggers, the
// device's clock, statistics, and faults with their time bounds.
#include <future>

#include "capture/camera_recovery.h"
#include "capture/frame/frame_checks.h"
#include "tests/loopback/gige_rig.h"

namespace etalon {
namespace {

// Of a width with which packed formats fill whole bytes.
GigeCameraOptions sensor(bool latches = false) {
    return {.width = 68, .height = 41, .latches = latches};
}

class GenicamFeatures : public testing::Test {
protected:
    std::unique_ptr<Camera> armed(GigeRig& rig, const CaptureSettings& settings) {
        auto camera = rig.open(link_);
        camera->configure(settings);
        camera->arm();
        return camera;
    }

    CameraLink link_;
};

// Every format that the mock packs, unpacked by the backend's own code; the mock's packing is
// independent of it.
TEST_F(GenicamFeatures, HandsOverEveryPixelFormatBitForBit) {
    const std::vector<std::pair<std::string, int>> formats{
        {"Mono8", 8},    {"Mono10", 10},   {"Mono12", 12},       {"Mono16", 16},
        {"Mono10p", 10}, {"Mono12p", 12},  {"Mono10Packed", 10}, {"Mono12Packed", 12},
        {"BayerRG8", 8}, {"BayerGB12", 12}};
    GigeRig rig(sensor());
    auto camera = rig.open(link_);
    for (const auto& [format, bits] : formats) {
        CaptureSettings wanted;
        wanted.format = format;
        wanted.bits = 0;  // as many as the format has
        EXPECT_EQ(camera->configure(wanted).bits, bits) << format;
        camera->arm();
        rig.show(picture(68, 41, bits, bits));
        const Frame frame = camera->frame_after(rig.clock_.now(), 5, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << format << ": " << frame.status_detail;
        EXPECT_TRUE(same(frame.image.pixels, rig.shown().pixels)) << format;
        EXPECT_EQ(frame.image.bits, bits);
        EXPECT_EQ(frame.settings.format, format);
        EXPECT_EQ(frame.mosaic, format == "BayerRG8"    ? Mosaic::rggb
                                : format == "BayerGB12" ? Mosaic::gbrg
                                                        : Mosaic::none);
        camera->disarm();
    }
}

TEST_F(GenicamFeatures, ChoosesThePlainestMonochromeFormatThatHoldsTheBits) {
    GigeRig rig(sensor());
    auto camera = rig.open(link_);
    const auto chosen = [&](int bits) {
        CaptureSettings wanted{.bits = bits};
        return camera->configure(wanted).format;
    };
    EXPECT_EQ(chosen(7), "Mono8");
    EXPECT_EQ(chosen(10), "Mono10");
    EXPECT_EQ(chosen(11), "Mono12");
    EXPECT_EQ(chosen(14), "Mono16");
    CaptureSettings shallow{.bits = 8, .format = "Mono12p"};
    EXPECT_THROW(camera->configure(shallow), DeviceError);
}

TEST_F(GenicamFeatures, PutsBlackLevelGainAndFeaturesByNameInForce) {
    GigeRig rig(sensor());
    auto camera = rig.open(link_);
    CaptureSettings wanted{
        .gain_db = 3.0, .black_level = 17.0, .controls = {{"AcquisitionFrameRate", 40.0}}};
    const CaptureSettings actual = camera->configure(wanted);
    EXPECT_EQ(actual.black_level, 17.0);
    EXPECT_EQ(actual.controls.at("AcquisitionFrameRate"), 40.0);
    camera->arm();
    camera->frame_after(rig.clock_.now(), 5, {});
    EXPECT_EQ(rig.asked().black_level, 17.0);
    EXPECT_EQ(rig.asked().gain_db, 3.0);
}

TEST_F(GenicamFeatures, SwitchesAutomaticFunctionsOff) {
    GigeRig rig(sensor());
    auto camera = rig.open(link_);
    const auto automatic_gain = [&] { return control_of(*camera, "GainAuto").value; };
    camera->configure({.controls = {{"GainAuto", 2.0}}});
    EXPECT_EQ(automatic_gain(), "Continuous");
    camera->configure({});
    EXPECT_EQ(automatic_gain(), "Off");
}

TEST_F(GenicamFeatures, ListsFormatsAndControlsWithTheirRanges) {
    GigeRig rig(sensor());
    auto camera = rig.open(link_);
    const CameraAbilities abilities = camera->abilities();
    ASSERT_EQ(abilities.formats.size(), 10u);
    EXPECT_EQ(abilities.formats[5].name, "Mono12p");
    EXPECT_EQ(abilities.formats[5].bits, 12);
    EXPECT_EQ(abilities.formats[5].sizes.at(0).largest, cv::Size(68, 41));
    const auto control = [&](const std::string& name) { return control_of(*camera, name); };
    EXPECT_EQ(control("ExposureTime").value, "10000");
    EXPECT_EQ(control("ExposureTime").unit, "us");
    EXPECT_EQ(control("ExposureTime").low, 10.0);
    EXPECT_EQ(control("BlackLevel").high, 255.0);
    EXPECT_EQ(control("GainAuto").choices, (std::vector<std::string>{"Off", "Continuous"}));
}

TEST_F(GenicamFeatures, WaitsForTheLineThatTriggersIt) {
    GigeRig rig(sensor(true));
    link_.frame_timeout = 400ms;
    auto camera = armed(rig, {.trigger = "Line1"});
    EXPECT_EQ(camera->frame_after(rig.clock_.now(), 0, {}).status, FrameStatus::timed_out);
    const Instant t = rig.clock_.now();
    std::thread line([&] {
        SteadyClock().wait_for(50ms, {});
        rig.device_->pulse_line();
    });
    const Frame frame = camera->frame_after(t, 2, {});
    line.join();
    ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_EQ(frame.settings.trigger, "Line1");
    EXPECT_EQ(frame.time_source, TimeSource::device_clock);
    EXPECT_GT(frame.exposure_start - frame.exposure_start_uncertainty, t);
}

// A device without a clock to read is dated by its trigger; with one, by the intersection.
TEST_F(GenicamFeatures, DatesAFrameByTheDevicesClockWhereThereIsOne) {
    for (const bool latches : {false, true}) {
        GigeRig rig(sensor(latches));
        auto camera = armed(rig, {.exposure = 2000us});
        const Instant before = rig.clock_.now();
        const Frame frame = camera->frame_after(before, 5, {});
        EXPECT_EQ(frame.time_source, latches ? TimeSource::device_clock : TimeSource::request);
        EXPECT_GT(frame.device_time_ns, 0u);
        EXPECT_GT(frame.exposure_start - frame.exposure_start_uncertainty, before);
        EXPECT_LT(frame.exposure_start + frame.exposure_start_uncertainty, rig.clock_.now());
    }
}

TEST_F(GenicamFeatures, RefusesFramesWhoseClockJumpedAndRecovers) {
    for (const std::chrono::nanoseconds jump :
         {std::chrono::nanoseconds(-1h), 1000000000ns * 3600}) {
        GigeRig rig(sensor(true));
        auto camera = armed(rig, {.trigger = "none", .controls = {{"AcquisitionFrameRate", 50.0}}});
        ASSERT_EQ(camera->frame_after(rig.clock_.now(), 0, {}).status, FrameStatus::complete);
        // Between the reading of the clock and the next frame, if it does not come within 5 ms:
        // of 20.
        bool refused = false;
        for (int i = 0; i < 10 && !refused; ++i) {
            std::thread jumping([&] {
                SteadyClock().wait_for(5ms, {});
                rig.device_->jump_clock(jump);
            });
            const Instant asked = rig.clock_.now();
            const Frame frame = camera->frame_after(asked, 0, {});
            jumping.join();
            refused = frame.status == FrameStatus::corrupt &&
                      frame.status_detail.find("time stamp") != std::string::npos;
            if (!refused) {
                EXPECT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
                EXPECT_GT(frame.exposure_start - frame.exposure_start_uncertainty, asked);
            }
        }
        EXPECT_TRUE(refused);
        const Instant t = rig.clock_.now();
        const Frame next = camera->frame_after(rig.clock_.now(), 3, {});
        ASSERT_EQ(next.status, FrameStatus::complete) << next.status_detail;
        EXPECT_LT(next.exposure_start, rig.clock_.now());
        EXPECT_LT(rig.clock_.now() - t, 2s);
    }
}

TEST_F(GenicamFeatures, CountsWhatTheStreamLost) {
    GigeRig rig(sensor());
    link_.frame_timeout = 300ms;
    auto camera = armed(rig, {});
    constexpr int lossy = 5;  // of 4 packets each: all 20 arrive once in a million runs
    rig.device_->lose_packets(0.5, lossy);
    for (int i = 0; i < lossy; ++i)
        camera->frame_after(rig.clock_.now(), 20, {});
    const CaptureStatistics counts = camera->statistics();
    EXPECT_EQ(counts.delivered, lossy);
    EXPECT_GT(counts.rejected + counts.missing_packets, 0);
    camera->disarm();
    EXPECT_EQ(camera->statistics().missing_packets, counts.missing_packets);
}

// A camera whose buffers fill while nobody looks.
TEST_F(GenicamFeatures, CountsUnderrunsAndSkippedFrames) {
    GigeRig rig(sensor(true));
    auto camera = armed(rig, {.trigger = "none", .controls = {{"AcquisitionFrameRate", 100.0}}});
    rig.clock_.wait_for(400ms, {});
    EXPECT_EQ(camera->frame_after(rig.clock_.now(), 3, {}).status, FrameStatus::complete);
    EXPECT_GT(camera->statistics().underruns, 10);
    EXPECT_GT(camera->statistics().skipped, 10);
}

TEST_F(GenicamFeatures, SaysThatAFrozenCameraIsGoneAndTakesItUpAgain) {
    GigeRig rig(sensor());
    auto camera = armed(rig, {.exposure = 7000us, .gain_db = 5.0});
    rig.device_->freeze();
    const Instant frozen = rig.clock_.now();
    EXPECT_THROW(camera->frame_after(frozen, 100, {}), DeviceError);
    // The frame's time-out of 1 s, and two requests of 2.5 s: the heartbeat's before ours.
    EXPECT_LT(rig.clock_.now() - frozen, 7s);
    std::thread thawing([&] {
        SteadyClock().wait_until(frozen + 5s, {});
        rig.device_->thaw();
    });
    camera->reconnect(rig.clock_.now() + 15s, {});
    thawing.join();
    EXPECT_LT(rig.clock_.now() - frozen, 20s);
    const Frame frame = camera->frame_after(rig.clock_.now(), 5, {});
    ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
    EXPECT_EQ(rig.asked().exposure, 7000us);
    EXPECT_EQ(rig.asked().gain_db, 5.0);
    EXPECT_EQ(camera->statistics().reconnects, 1);
}

// The dead one's stream still runs when it is taken over, and would go on to where nobody listens.
TEST_F(GenicamFeatures, StreamsToTheNextProgramWhenTheOneBeforeWasKilled) {
    GigeRig rig(sensor());
    {
        Program victim("etalon", {"capture", "--camera", "genicam:127.0.0.1", "--live"});
        while (rig.asked().width == 0)  // until a frame is exposed
            rig.clock_.wait_for(5ms, {});
        victim.send(SIGKILL);
        victim.exit_code();
    }
    const Instant killed = rig.clock_.now();
    const auto camera = open_when_free([&] { return rig.open(); }, rig.clock_, {}, [](auto&) {});
    camera->configure({});
    camera->arm();
    EXPECT_EQ(camera->frame_after(rig.clock_.now(), 5, {}).status, FrameStatus::complete);
    EXPECT_LT(rig.clock_.now() - killed, 8s);
}

TEST_F(GenicamFeatures, DoesNotTakeAnotherCameraForTheOneThatWasLost) {
    GigeRig rig(sensor());
    auto camera = armed(rig, {});
    rig.device_.reset();
    EXPECT_THROW(camera->frame_after(rig.clock_.now(), 0, {}), DeviceError);
    rig.options_.serial = "OTHER";
    rig.restart();
    EXPECT_THAT(device_error_of([&] { camera->reconnect(rig.clock_.now() + 10s, {}); }),
                HasSubstr("OTHER"));
    EXPECT_THROW(camera->frame_after(rig.clock_.now(), 0, {}), DeviceError);
}

TEST_F(GenicamFeatures, OpensThroughTheNetworkCardThatIsNamed) {
    GigeRig rig(sensor());
    link_.interface = "127.0.0.1";
    link_.packet_delay = 1us;  // the largest that this camera allows
    auto camera = armed(rig, {});
    EXPECT_EQ(camera->frame_after(rig.clock_.now(), 5, {}).status, FrameStatus::complete);
    camera.reset();
    link_.packet_delay = 2us;
    EXPECT_THROW(rig.open(link_), DeviceError);
    link_.interface = "no address";
    EXPECT_THROW(rig.open(link_), DeviceError);
}

// ---- powered camera

// A camera that loses its power while frames are taken and gets it back: as a program of its own,
// killed in mid-stream, so that nothing of it is left that could say goodbye.

// Its parameter is the trigger: by software, or none for a camera that runs freely.
class PoweredCameraTest : public testing::TestWithParam<const char*> {
protected:
    static CaptureSettings wanted() {
        return {.width = 150,
                .height = 80,
                .bits = 12,
                .format = "Mono12p",
                .exposure = 7000us,
                .gain_db = 3.0,
                .black_level = 5.0,
                .trigger = GetParam(),
                .controls = {{"AcquisitionFrameRate", 40.0}}};
    }

    // Takes frames of picture `number`, cuts the power after the fifth while more are taken, and
    // returns how long it took to notice.
    Duration time_to_notice_the_cut(Camera& camera, int number) {
        std::future<Instant> cut;
        const auto cut_power = [this] {
            const Instant now = clock_.now();
            power_.cut_power();
            return now;
        };
        try {
            for (int frames = 1;; ++frames) {
                const Frame frame = camera.frame_after(clock_.now(), 5, {});
                if (frame.status == FrameStatus::complete) {
                    EXPECT_TRUE(same(frame.image.pixels, PoweredCamera::shown(number).pixels));
                }
                if (frames == 5)
                    cut = std::async(std::launch::async, cut_power);
            }
        } catch (const DeviceError&) {
            const Instant noticed = clock_.now();
            return cut.valid() ? noticed - cut.get() : Duration::max();
        }
    }

    SteadyClock clock_;
    PoweredCamera power_;
};

TEST_P(PoweredCameraTest, IsTakenUpAgainWithEverySettingAfterItWasKilledInMidStream) {
    power_.switch_on(1);
    auto camera = open_camera("genicam:127.0.0.1", {}, clock_);
    const std::string rate_after_power_up = control_of(*camera, "AcquisitionFrameRate").value;
    const CaptureSettings before = camera->configure(wanted());
    camera->arm();
    EXPECT_LT(time_to_notice_the_cut(*camera, 1), 10s);
    EXPECT_THROW(camera->frame_after(clock_.now(), 5, {}), DeviceError);
    EXPECT_THROW(camera->reconnect(clock_.now() + 200ms, {}), DeviceError);

    power_.switch_on(2);
    const Instant back = clock_.now();
    camera->reconnect(back + 15s, {});
    EXPECT_LT(clock_.now() - back, 15s);
    EXPECT_EQ(camera->statistics().reconnects, 1);
    for (int i = 0; i < 5; ++i) {
        const Frame frame = camera->frame_after(clock_.now(), 5, {});
        ASSERT_EQ(frame.status, FrameStatus::complete) << frame.status_detail;
        EXPECT_TRUE(same(frame.image.pixels, PoweredCamera::shown(2).pixels));
        EXPECT_FALSE(first_difference(before, frame.settings, 0.0).has_value());
    }
    EXPECT_EQ(power_.exposed_with(), "Mono12p, 7000 us, 3 dB, black level 5");
    camera->disarm();
    EXPECT_EQ(control_of(*camera, "AcquisitionFrameRate").value, "40");
    EXPECT_NE(rate_after_power_up, "40");
}

INSTANTIATE_TEST_SUITE_P(Triggers, PoweredCameraTest, testing::Values("Software", "none"),
                         [](const auto& trigger) {
                             return std::string(trigger.param) == "none" ? "Free" : "Software";
                         });

}  // namespace
}  // namespace etalon
