// The contract, kept by what is no device: the mock and recorded frames.
#include <opencv2/imgcodecs.hpp>

#include "capture/files_camera.h"
#include "tests/capture/frame/camera_contract.h"
#include "tests/fakes/fake_camera.h"

namespace etalon {
namespace {

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
