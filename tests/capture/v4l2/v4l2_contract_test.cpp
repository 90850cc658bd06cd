// The contract of Camera, kept by the V4L2 backend over a scripted device.

#include "capture/v4l2/v4l2_camera.h"
#include "tests/capture/frame/camera_contract.h"
#include "tests/fakes/fake_v4l2.h"

namespace etalon {
namespace {

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
