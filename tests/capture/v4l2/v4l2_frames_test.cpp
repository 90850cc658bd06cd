// What the V4L2 backend makes of frames and of their stamps, counters and flags, over a scripted
// device.
#include "capture/v4l2/v4l2_timing.h"
#include "tests/capture/frame/camera_contract.h"
#include "tests/capture/v4l2/v4l2_fixture.h"

namespace etalon {
namespace {

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
    EXPECT_THAT(device_error_of([&] { frame(*camera); }), HasSubstr("above 1023"));
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

// ---- v4l2 contract

// The contract of Camera, kept by the V4L2 backend over a scripted device.

struct Kind {
    std::string format = "GREY";
    int bits = 8;
    FakeV4l2::Stamps stamps = FakeV4l2::Stamps::frame_end;
    std::string driver = "uvcvideo";
    bool multi_planar = false;
    unsigned padding = 0;
};

class V4l2Rig final : public CameraRig {
public:
    explicit V4l2Rig(const Kind& kind)
        : kind_(kind),
          device_(clock_),
          settings_{.width = 17,
                    .height = 11,
                    .bits = kind.bits,
                    .format = kind.format,
                    .exposure = 7000us} {
        clock_.advance(1h);
        device_.formats = {"YUYV", "GREY", "Y16 ", "Y12P"};
        device_.width_limit = 17;
        device_.stamps = kind.stamps;
        device_.driver = kind.driver;
        device_.multi_planar = kind.multi_planar;
        device_.padding = kind.padding;
        device_.picture = [this](Instant t) { return bytes_at(t); };
    }

    Clock& clock() override { return clock_; }
    std::unique_ptr<Camera> open() override {
        return open_v4l2_camera(device_.bus, {}, clock_, device_);
    }
    CaptureSettings settings() const override { return settings_; }
    std::vector<Refusal> refusals() const override {
        return {{"18x11", [](CaptureSettings& s) { s.width = 18; }},
                {"300000 us", [](CaptureSettings& s) { s.exposure = 300ms; }},
                {"3 dB", [](CaptureSettings& s) { s.gain_db = 3.0; }},
                {"bits", [](CaptureSettings& s) { s.bits += 5; }},
                {"Line1", [](CaptureSettings& s) { s.trigger = "Line1"; }},
                {"H264", [](CaptureSettings& s) { s.format = "H264"; }},
                {"sharpness", [](CaptureSettings& s) { s.controls["sharpness"] = 9; }}};
    }
    bool show(const CodeImage& scene) override {
        scenes_.emplace_back(clock_.now(), scene.pixels.clone());
        return true;
    }
    std::optional<FrameStatus> spoil(FrameFault fault, int frames) override;
    bool unplug() override {
        device_.unplug();
        return true;
    }
    bool plug_in() override {
        device_.plug_in("/dev/video1");
        return true;
    }

private:
    std::vector<std::uint8_t> bytes_at(Instant t) const;

    Kind kind_;
    VirtualClock clock_;
    FakeV4l2 device_;
    CaptureSettings settings_;
    std::vector<std::pair<Instant, cv::Mat>> scenes_;
};

// Spoils the first frames that are surely not too old for a request made now.
std::optional<FrameStatus> V4l2Rig::spoil(FrameFault fault, int frames) {
    if (fault == FrameFault::lost)
        return std::nullopt;  // what a free-running camera loses, it does not announce
    const bool usb = kind_.driver == "uvcvideo";
    const bool start = kind_.stamps == FakeV4l2::Stamps::exposure_start;
    const Duration to_end = 7ms + device_.readout;
    const Duration margin = usb     ? 4 * device_.period - (start ? 0ms : to_end)
                            : start ? 500us
                            : kind_.stamps == FakeV4l2::Stamps::frame_end
                                ? device_.period - device_.readout
                                : device_.period;
    const Instant from = clock_.now() + margin, to = from + frames * device_.period;
    device_.spoil = [=](FakeV4l2Frame& frame) {
        if (frame.exposure_start <= from || frame.exposure_start > to)
            return;
        if (fault == FrameFault::cut_short)
            frame.bytes_used -= 100;
        else if (fault == FrameFault::damaged)
            frame.error_flag = true;
        else
            frame.done += 5s;
    };
    return fault == FrameFault::cut_short ? FrameStatus::short_frame
           : fault == FrameFault::damaged ? FrameStatus::corrupt
                                          : FrameStatus::timed_out;
}

std::vector<std::uint8_t> line_of(const cv::Mat& codes, int y, const std::string& format) {
    std::vector<std::uint8_t> line;
    const auto add = [&](int byte) { line.push_back(static_cast<std::uint8_t>(byte)); };
    for (int x = 0; x < codes.cols; ++x) {
        const int code =
            codes.depth() == CV_8U ? codes.at<std::uint8_t>(y, x) : codes.at<std::uint16_t>(y, x);
        const int next =
            codes.depth() == CV_16U && x + 1 < codes.cols ? codes.at<std::uint16_t>(y, x + 1) : 0;
        if (format == "GREY")
            add(code);
        else if (format == "YUYV")
            add(code), add(131);
        else if (format == "Y16")
            add(code), add(code >> 8);
        else if (x % 2 == 0)  // Y12P
            add(code >> 4), add(next >> 4), add((code & 15) | (next & 15) << 4);
    }
    if (format == "YUYV")
        add(0), add(131);  // pixels come in pairs
    return line;
}

std::vector<std::uint8_t> V4l2Rig::bytes_at(Instant t) const {
    cv::Mat codes = cv::Mat::zeros(11, 17, kind_.bits <= 8 ? CV_8UC1 : CV_16UC1);
    for (const auto& [since, scene] : scenes_)
        if (since <= t)
            codes = scene;
    std::vector<std::uint8_t> bytes;
    for (int y = 0; y < codes.rows; ++y) {
        const auto line = line_of(codes, y, kind_.format);
        bytes.insert(bytes.end(), line.begin(), line.end());
        bytes.insert(bytes.end(), kind_.padding, 213);
    }
    return bytes;
}

CameraRigMaker rig(const std::string& name, const Kind& kind) {
    return {name, [=] { return std::make_unique<V4l2Rig>(kind); }};
}

INSTANTIATE_TEST_SUITE_P(
    V4l2, CameraContract,
    testing::Values(
        rig("Grey", {}), rig("Yuyv", {.format = "YUYV", .padding = 6}),
        rig("Y16With12Bits", {.format = "Y16", .bits = 12}),
        rig("Y12PMultiPlanar", {.format = "Y12P", .bits = 12, .multi_planar = true, .padding = 5}),
        rig("StampsOfFirstData", {.stamps = FakeV4l2::Stamps::exposure_start}),
        rig("StampsOfExposureStart",
            {.stamps = FakeV4l2::Stamps::exposure_start, .driver = "sensor"}),
        rig("StampsOfAnUnknownClock", {.stamps = FakeV4l2::Stamps::unknown, .driver = "capture"})),
    rig_name);

}  // namespace
}  // namespace etalon
