// The contract of Camera, kept by the GenICam backend on loopback: for packed and plain formats,
// for a camera that is triggered by software and for one that runs freely, with and without a clock
// that can be read, with and without chunks.
#include <arv.h>

#include "tests/capture/frame/camera_contract.h"
#include "tests/loopback/gige_rig.h"

namespace etalon {
namespace {

struct GenicamCase {
    std::string format;
    int bits = 8;
    std::string trigger = "Software";
    bool latches = false;
    std::uint16_t chunk_payload_type = 0;
};

GigeCameraOptions options_of(const GenicamCase& tested) {
    return {.width = 150,  // 12 kB and more: 23 packets of 576 bytes
            .height = 80,
            .bits = tested.bits,
            .latches = tested.latches,
            .chunk_payload_type = tested.chunk_payload_type};
}

// What no camera here does.
std::vector<CameraRig::Refusal> refusals_of_any(const char* size, int too_wide) {
    return {{size, [too_wide](CaptureSettings& s) { s.width = too_wide; }},
            {"11000000 us", [](CaptureSettings& s) { s.exposure = 11s; }},
            {"11 dB", [](CaptureSettings& s) { s.gain_db = 11.0; }},
            {"Mono14", [](CaptureSettings& s) { s.format = "Mono14"; }},
            {"Sharpness", [](CaptureSettings& s) { s.controls["Sharpness"] = 1.0; }}};
}

class GenicamContractRig final : public CameraRig {
public:
    explicit GenicamContractRig(const GenicamCase& tested)
        : case_(tested), rig_(options_of(tested)) {}

    Clock& clock() override { return rig_.clock_; }
    std::unique_ptr<Camera> open() override {
        return rig_.open({.frame_timeout = 400ms, .packet_size = 576});
    }
    CaptureSettings settings() const override {
        CaptureSettings settings = rig_.settings();
        settings.format = case_.format;
        settings.trigger = case_.trigger;
        settings.exposure = 7000us;
        settings.gain_db = 3.0;
        settings.black_level = 5.0;
        if (case_.trigger == "none")
            settings.controls["AcquisitionFrameRate"] = 50.0;
        return settings;
    }
    std::vector<Refusal> refusals() const override {
        std::vector<Refusal> all = refusals_of_any("151x80", 151);
        all.insert(all.end(), {{"level 256", [](CaptureSettings& s) { s.black_level = 256.0; }},
                               {"2.5 dB", [](CaptureSettings& s) { s.gain_db = 2.5; }},
                               {"17", [](CaptureSettings& s) {
                                    s.format = "";
                                    s.bits = 17;
                                }}});
        return all;
    }
    bool show(const CodeImage& scene) override {
        rig_.show(scene);
        return true;
    }
    // A camera that runs freely sends its bad frame when it likes.
    std::optional<FrameStatus> spoil(FrameFault fault, int frames) override {
        if (case_.trigger != "Software" || fault == FrameFault::lost)
            return std::nullopt;
        if (fault == FrameFault::cut_short) {
            rig_.device_->cut_short(frames);
            return FrameStatus::short_frame;
        }
        // Half of 23 packets: all or none of them arrive with a chance of 2e-7.
        rig_.device_->lose_packets(fault == FrameFault::damaged ? 0.5 : 1.0, frames);
        return fault == FrameFault::damaged ? FrameStatus::corrupt : FrameStatus::timed_out;
    }
    bool unplug() override {
        rig_.device_.reset();
        return true;
    }
    bool plug_in() override {
        rig_.restart();
        return true;
    }

private:
    GenicamCase case_;
    GigeRig rig_;
};

CameraRigMaker rig(const std::string& name, const GenicamCase& tested) {
    return {name, [=] { return std::make_unique<GenicamContractRig>(tested); }};
}

// Aravis' camera without a transport: a device of its own kind inside this process, `Fake_1`, that
// can be opened while an object of this class exists. Not GigE Vision: no packets, no control to
// lose, names of features as before SFNC 2, and pixels that are the library's.
class InProcessCamera {
public:
    InProcessCamera() { arv_enable_interface("Fake"); }
    ~InProcessCamera() { arv_disable_interface("Fake"); }
    InProcessCamera(const InProcessCamera&) = delete;
    InProcessCamera& operator=(const InProcessCamera&) = delete;
};

// Another transport than GigE Vision, as far as one can be had without a device.
class InProcessRig final : public CameraRig {
public:
    Clock& clock() override { return clock_; }
    std::unique_ptr<Camera> open() override { return open_camera("genicam:Fake_1", {}, clock_); }
    CaptureSettings settings() const override {
        return {.width = 150,
                .height = 80,
                .bits = bits_,
                .exposure = 7000us,
                .gain_db = 3.0,
                .trigger = trigger_};
    }
    std::vector<Refusal> refusals() const override { return refusals_of_any("4096x80", 4096); }

    InProcessRig(int bits, const std::string& trigger) : bits_(bits), trigger_(trigger) {}

private:
    InProcessCamera device_;
    SteadyClock clock_;
    int bits_;
    std::string trigger_;
};

CameraRigMaker in_process(const std::string& name, int bits, const std::string& trigger) {
    return {name, [=] { return std::make_unique<InProcessRig>(bits, trigger); }};
}

INSTANTIATE_TEST_SUITE_P(InProcess, CameraContract,
                         testing::Values(in_process("Mono8", 8, "Software"),
                                         in_process("FreeMono16", 16, "none")),
                         rig_name);

INSTANTIATE_TEST_SUITE_P(
    Genicam, CameraContract,
    testing::Values(rig("Mono8", {"Mono8", 8}), rig("Mono12p", {"Mono12p", 12}),
                    rig("FreeWithoutClock", {"Mono8", 8, "none"}),
                    rig("FreeWithClockMono12Packed", {"Mono12Packed", 12, "none", true}),
                    rig("Chunks", {"Mono12", 12, "Software", false, image_with_chunks}),
                    rig("FreeWithChunksOnly", {"Mono8", 8, "none", true, chunks_only})),
    rig_name);

}  // namespace
}  // namespace etalon
