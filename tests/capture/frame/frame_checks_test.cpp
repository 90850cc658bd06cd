#include "capture/frame/frame_checks.h"

#include <opencv2/imgcodecs.hpp>

#include "capture/files_camera.h"
#include "capture/frame/frame_average.h"
#include "capture/frame/handover_queue.h"
#include "tests/capture/frame/camera_contract.h"
#include "tests/fakes/fake_camera.h"

namespace etalon {
namespace {

TEST(FrameId, AdvancesWhenItGrows) {
    EXPECT_TRUE(frame_id_advanced(7, 8));
    EXPECT_TRUE(frame_id_advanced(7, 12));  // frames between were lost: still later
    EXPECT_FALSE(frame_id_advanced(7, 7));
    EXPECT_FALSE(frame_id_advanced(12, 7));
}

TEST(FrameId, WrapsFrom65535To1BecauseZeroIsNoBlockId) {
    EXPECT_TRUE(frame_id_advanced(65535, 1));
    EXPECT_TRUE(frame_id_advanced(65530, 5));
    EXPECT_FALSE(frame_id_advanced(1, 65535));
    EXPECT_FALSE(frame_id_advanced(5, 65530));
}

TEST(FrameId, OfAnExtendedStreamNeverWraps) {
    EXPECT_TRUE(frame_id_advanced(65535, 65536));
    EXPECT_TRUE(frame_id_advanced(70'000, 5'000'000'000));
    EXPECT_FALSE(frame_id_advanced(70'000, 5));
}

TEST(BitDepth, FitsItsContainerOnly) {
    EXPECT_TRUE(bits_fit_depth(8, CV_8U));
    EXPECT_TRUE(bits_fit_depth(5, CV_8U));
    EXPECT_FALSE(bits_fit_depth(9, CV_8U));
    EXPECT_TRUE(bits_fit_depth(12, CV_16U));
    EXPECT_FALSE(bits_fit_depth(8, CV_16U));
    EXPECT_FALSE(bits_fit_depth(17, CV_16U));
    EXPECT_FALSE(bits_fit_depth(12, CV_32F));
}

TEST(FullScale, IsExceededByHighAlignedCodes) {
    CodeImage image{cv::Mat(3, 5, CV_16UC1, cv::Scalar(100)), 12};
    image.pixels.at<std::uint16_t>(2, 4) = 4095;
    EXPECT_FALSE(exceeds_full_scale(image));
    image.pixels.at<std::uint16_t>(2, 4) = 4095 << 4;
    EXPECT_TRUE(exceeds_full_scale(image));
}

TEST(FullScale, CannotBeExceededByPackedCodesOfAllTheirBits) {
    EXPECT_FALSE(can_exceed_full_scale(*find_pfnc_format("Mono8"), 8));
    EXPECT_TRUE(can_exceed_full_scale(*find_pfnc_format("Mono8"), 7));
    EXPECT_FALSE(can_exceed_full_scale(*find_pfnc_format("Mono12p"), 12));
    EXPECT_TRUE(can_exceed_full_scale(*find_pfnc_format("Mono12p"), 10));
    EXPECT_TRUE(can_exceed_full_scale(*find_pfnc_format("Mono12"), 12));
    EXPECT_FALSE(can_exceed_full_scale(*find_pfnc_format("Mono16"), 16));
}

TEST(SettingDifference, IsFoundInSizeExposureAndGain) {
    const CaptureSettings wanted{.width = 67, .height = 41, .exposure = 7000us, .gain_db = 3.0};
    EXPECT_FALSE(first_difference(wanted, wanted, 0.5));
    CaptureSettings narrow = wanted, low = wanted, longer = wanted, loud = wanted, broken = wanted;
    narrow.width = 64;
    low.height = 40;
    longer.exposure += 5us;
    loud.gain_db = 3.1;
    broken.gain_db = std::nan("");
    for (const CaptureSettings& actual : {narrow, low, longer, loud, broken})
        EXPECT_TRUE(first_difference(wanted, actual, 0.5));
    EXPECT_EQ(first_difference(wanted, longer, 0.5)->request, "set exposure 7000 us");
    EXPECT_EQ(first_difference(wanted, longer, 0.5)->cause, "the device uses 7005 us");
    EXPECT_FALSE(first_difference(wanted, longer, 7.0)) << "within the device's own step";
}

TEST(SettingDifference, IsFoundInFormatBlackLevelTriggerAndControls) {
    const CaptureSettings wanted{.bits = 12,
                                 .format = "Mono12p",
                                 .black_level = 7.0,
                                 .trigger = "Line1",
                                 .controls = {{"Gamma", 0.7}, {"Sharpness", 0.0}}};
    EXPECT_FALSE(first_difference(wanted, wanted, 0.5));
    CaptureSettings shallow = wanted, packed = wanted, darker = wanted, unknown = wanted,
                    free = wanted, sharper = wanted, without = wanted;
    shallow.bits = 10;
    packed.format = "Mono12Packed";
    darker.black_level = 5.0;
    unknown.black_level.reset();
    free.trigger = "none";
    sharper.controls["Sharpness"] = 3.0;
    without.controls.erase("Gamma");
    for (const CaptureSettings& actual : {shallow, packed, darker, unknown, free, sharper, without})
        EXPECT_TRUE(first_difference(wanted, actual, 0.5));
    EXPECT_EQ(first_difference(wanted, unknown, 0.5)->cause, "the device has none");
    EXPECT_EQ(first_difference(wanted, sharper, 0.5)->cause, "the device uses 3");
}

TEST(SettingDifference, IgnoresWhatWasLeftToTheDevice) {
    const CaptureSettings actual{.width = 67,
                                 .height = 41,
                                 .format = "Mono8",
                                 .exposure = 7000us,
                                 .black_level = 7.0,
                                 .trigger = "Software"};
    EXPECT_FALSE(first_difference({}, actual, 0.5));
}

TEST(FrameChecks, SaysWhichCodesAreTooLargeForTheirBits) {
    const CodeImage image{cv::Mat(3, 5, CV_16UC1, cv::Scalar(4096)), 12};
    EXPECT_NE(code_fault(image, *find_pfnc_format("Mono12")).find("above 4095"), std::string::npos);
    EXPECT_EQ(code_fault({image.pixels, 13}, *find_pfnc_format("Mono16")), "");
    EXPECT_EQ(code_fault(image, *find_pfnc_format("Mono12p")), "");
}

// A camera whose frames break now and then also loses one without a trace: it is not gone.
TEST(FrameChecks, ReturnsTheLastFrameThatCameAtAll) {
    CaptureStatistics counts;
    std::vector<FrameStatus> script = {FrameStatus::timed_out, FrameStatus::short_frame,
                                       FrameStatus::corrupt, FrameStatus::timed_out};
    std::size_t taken = 0;
    const auto take = [&] {
        Frame frame;
        frame.status = script.at(taken++);
        return frame;
    };
    EXPECT_EQ(first_complete_frame(3, counts, take).status, FrameStatus::corrupt);
    EXPECT_EQ(counts.rejected, 4);
    script.assign(2, FrameStatus::timed_out);
    taken = 0;
    EXPECT_EQ(first_complete_frame(1, counts, take).status, FrameStatus::timed_out);
}

TEST(FrameChecks, TakesFramesUntilOneIsComplete) {
    CaptureStatistics counts;
    int taken = 0;
    const auto take = [&] {
        Frame frame;
        frame.status = ++taken == 3 ? FrameStatus::complete : FrameStatus::corrupt;
        return frame;
    };
    EXPECT_EQ(first_complete_frame(1, counts, take).status, FrameStatus::corrupt);
    EXPECT_EQ(first_complete_frame(4, counts, take).status, FrameStatus::complete);
    EXPECT_EQ(taken, 3);
    EXPECT_EQ(counts.rejected, 2);
    EXPECT_EQ(counts.delivered, 1);
}

// ---- device clock

TEST(DeviceClock, MapsAStampWithTheUncertaintyOfItsReading) {
    DeviceClock clock;
    EXPECT_FALSE(clock.known());
    clock.read(5'000'000'000, {Instant(70s), Instant(70s + 4ms)});
    const TimeWindow same = clock.station_time(5'000'000'000);
    EXPECT_EQ(same.middle(), Instant(70s + 2ms));
    EXPECT_EQ(same.half_width(), 2ms);
    const TimeWindow later = clock.station_time(5'000'000'000 + 10'000'000'000);
    EXPECT_EQ(later.middle(), Instant(80s + 2ms));
    EXPECT_EQ(later.half_width(), 4ms);  // + 200 ppm of 10 s
    const TimeWindow before = clock.station_time(4'000'000'000);
    EXPECT_EQ(before.earliest, Instant(69s - 200us));
    EXPECT_EQ(before.latest, Instant(69s + 4ms + 200us));
    clock.forget();
    EXPECT_FALSE(clock.known());
}

TEST(DeviceClock, GoesOnAcrossAWrapOfItsCounter) {
    DeviceClock clock;
    clock.read(~0ull - 999'999, {Instant(7s), Instant(7s)});
    EXPECT_EQ(clock.station_time(4'000'000).middle(), Instant(7s + 5ms));
}

TEST(TimeWindow, IsEmptyWhereTwoContradictEachOther) {
    const TimeWindow a{Instant(1s), Instant(5s)}, b{Instant(3s), Instant(9s)};
    EXPECT_EQ(intersection(a, b).earliest, Instant(3s));
    EXPECT_EQ(intersection(a, b).latest, Instant(5s));
    EXPECT_FALSE(intersection(a, b).empty());
    EXPECT_TRUE(intersection(a, {Instant(6s), Instant(7s)}).empty());
}

// ---- frame average

// Of frames with these codes, the second pixel one higher.
FrameAverage average_of(const std::vector<int>& codes) {
    FrameAverager averager;
    for (const int code : codes) {
        Frame frame;
        frame.image = {(cv::Mat_<std::uint16_t>(1, 2) << code, code + 1), 16};
        averager.add(frame);
    }
    return averager.average();
}

TEST(FrameAverage, IsTheMeanAndTheVarianceOfOneFrame) {
    const FrameAverage average = average_of({10, 14, 15});
    EXPECT_EQ(average.frames, 3);
    EXPECT_EQ(average.bits, 16);
    EXPECT_NEAR(average.mean.at<double>(0, 0), 13.0, 1e-12);
    EXPECT_NEAR(average.mean.at<double>(0, 1), 14.0, 1e-12);
    EXPECT_NEAR(average.variance.at<double>(0, 1), 7.0, 1e-12);  // (9 + 1 + 4) / 2
    EXPECT_NEAR(average.noise(), std::sqrt(7.0), 1e-12);
}

TEST(FrameAverage, LosesNothingOfSmallNoiseAtTheTopOfSixteenBits) {
    std::vector<int> codes;
    for (int i = 0; i < 400; ++i)
        codes.push_back(65533 + i % 2);
    // 400 values, each half a code from the mean: 400 / 4 / 399.
    EXPECT_NEAR(average_of(codes).variance.at<double>(0, 0), 100.0 / 399.0, 1e-9);
}

TEST(FrameAverage, NeedsTwoFrames) {
    EXPECT_THROW(average_of({3}), ConfigError);
}

// ---- handover queue

TEST(HandoverQueue, GivesValuesInTheirOrderAndNothingWhenThereIsNone) {
    HandoverQueue<int> queue;
    queue.push(7);
    queue.push(5);
    EXPECT_EQ(queue.pop(0ms, {}), 7);
    EXPECT_EQ(queue.pop(0ms, {}), 5);
    EXPECT_EQ(queue.pop(0ms, {}), std::nullopt);
}

TEST(HandoverQueue, WakesWhoWaitsForAValue) {
    HandoverQueue<int> queue;
    std::thread other([&] { queue.push(7); });
    EXPECT_EQ(queue.pop(1h, {}), 7);
    other.join();
}

TEST(HandoverQueue, WakesWhoWaitsForAValueThatWillNotCome) {
    HandoverQueue<int> queue;
    std::thread other([&] { queue.end(); });
    EXPECT_EQ(queue.pop(1h, {}), std::nullopt);
    other.join();
}

TEST(HandoverQueue, GivesWhatCameBeforeTheEnd) {
    HandoverQueue<int> queue;
    queue.push(7);
    queue.end();
    EXPECT_EQ(queue.pop(1h, {}), 7);
    EXPECT_EQ(queue.pop(1h, {}), std::nullopt);
}

TEST(HandoverQueue, StopsWaitingWhenAskedTo) {
    HandoverQueue<int> queue;
    std::stop_source stop;
    std::thread other([&] { stop.request_stop(); });
    EXPECT_THROW(queue.pop(1h, stop.get_token()), Interrupted);
    other.join();
}

// ---- camera contract

// The contract, kept by what is no device: the mock and recorded frames.

class MockRig final : public CameraRig {
public:
    explicit MockRig(int bits)
        : settings_{.width = 17, .height = 11, .bits = bits, .exposure = 7000us, .gain_db = 3.0},
          scene_{cv::Mat::zeros(11, 17, bits <= 8 ? CV_8UC1 : CV_16UC1), bits} {}

    Clock& clock() override { return clock_; }
    std::unique_ptr<Camera> open() override {
        auto camera = std::make_unique<FakeCamera>(
            [this](const CaptureSettings&) {
                return CodeImage{scene_.pixels.clone(), scene_.bits};
            },
            clock_);
        camera->alter_settings = [](CaptureSettings& asked) {
            asked.width = std::min(asked.width, 17);
            asked.gain_db = std::min(asked.gain_db, 24.0);
        };
        last_ = camera.get();
        return camera;
    }
    CaptureSettings settings() const override { return settings_; }
    std::vector<Refusal> refusals() const override {
        return {{"18x11", [](CaptureSettings& s) { s.width = 18; }},
                {"25 dB", [](CaptureSettings& s) { s.gain_db = 25.0; }}};
    }
    bool show(const CodeImage& scene) override {
        scene_ = scene;
        return true;
    }
    std::optional<FrameStatus> spoil(FrameFault fault, int frames) override {
        const FrameStatus status = fault == FrameFault::cut_short ? FrameStatus::short_frame
                                   : fault == FrameFault::damaged ? FrameStatus::corrupt
                                   : fault == FrameFault::lost    ? FrameStatus::lost
                                                                  : FrameStatus::timed_out;
        last_->script.assign(static_cast<std::size_t>(frames), status);
        return status;
    }
    bool unplug() override { return last_->unplugged = true; }
    bool plug_in() override { return !(last_->unplugged = false); }

private:
    VirtualClock clock_;
    CaptureSettings settings_;
    CodeImage scene_;
    FakeCamera* last_ = nullptr;
};

constexpr int recorded_frames_in_rig = 20;

// Frames that were recorded, as plain images or as a run with its log.
class FilesRig final : public CameraRig {
public:
    FilesRig(int bits, bool as_run) : settings_{.width = 17, .height = 11, .bits = bits} {
        for (int i = 0; i < recorded_frames_in_rig; ++i)
            cv::imwrite((folder_ / file(i)).string(),
                        cv::Mat(11, 17, bits <= 8 ? CV_8UC1 : CV_16UC1, cv::Scalar(i)));
        if (as_run)
            write_log();
    }

    Clock& clock() override { return clock_; }
    std::unique_ptr<Camera> open() override { return open_files_camera(folder_.path(), clock_); }
    CaptureSettings settings() const override { return settings_; }
    std::vector<Refusal> refusals() const override {
        return {{"18x11", [](CaptureSettings& s) { s.width = 18; }},
                {"5000 us", [](CaptureSettings& s) { s.exposure = 5000us; }},
                {"Line1", [](CaptureSettings& s) { s.trigger = "Line1"; }}};
    }

private:
    static std::string file(int number) { return "image" + std::to_string(100 + number) + ".png"; }
    void write_log() {
        settings_.exposure = 7000us;
        std::ofstream log(folder_ / "events.jsonl");
        for (int i = 0; i < recorded_frames_in_rig; ++i)
            log << R"({"t":0,"event":"frame","pose":)" << i << R"(,"file":")" << file(i)
                << R"(","sha256":"","status":"complete","status_detail":"","device_id":)"
                << 65530 + i << R"(,"exposure_start_uncertainty_s":0,"time_source":"request")"
                << R"(,"device_time_ns":0,"detection":"","corners":[])"
                << R"(,"settings":{"width":17,"height":11,"exposure_us":7000,"gain_db":0)"
                << R"(,"format":"","black_level":null,"trigger":"","controls":{},"bits":)"
                << settings_.bits << "}}\n";
    }

    VirtualClock clock_;
    TemporaryFolder folder_;
    CaptureSettings settings_;
};

template <typename Rig, typename... Arguments>
CameraRigMaker rig(const std::string& name, Arguments... arguments) {
    return {name, [=] { return std::make_unique<Rig>(arguments...); }};
}

INSTANTIATE_TEST_SUITE_P(Mock, CameraContract,
                         testing::Values(rig<MockRig>("Bits8", 8), rig<MockRig>("Bits12", 12)),
                         rig_name);
INSTANTIATE_TEST_SUITE_P(Replay, CameraContract,
                         testing::Values(rig<FilesRig>("ImagesBits8", 8, false),
                                         rig<FilesRig>("ImagesBits16", 16, false),
                                         rig<FilesRig>("RunBits12", 12, true)),
                         rig_name);

}  // namespace
}  // namespace etalon
