// The USB camera behind one of the product's backends, for the contract that every backend keeps
// (tests/capture/frame/camera_contract.h) and for tests of what only a real driver does.
#pragma once

#include "tests/capture/frame/camera_contract.h"
#include "tests/vm/device_events.h"
#include "tests/vm/test_pattern.h"

namespace etalon {

// How a backend names the camera and its formats, and what it can set.
struct UsbBackend {
    std::string name;  // "v4l2" or "libcamera"
    bool sets_exposure = false;
};

class UsbRig : public CameraRig {
public:
    // `format` is the backend's name for `pixels`; `bits` is what it makes of them.
    UsbRig(UsbBackend backend, UsbPixels pixels, std::string format, int bits)
        : backend_(std::move(backend)),
          pixels_(pixels),
          format_(std::move(format)),
          bits_(bits),
          camera_({.sizes = {{640, 480}, {width, height}}, .frames_per_second = 60},
                  [this](const UsbExposure& exposure) { return expose(exposure); }) {
        device_ = next_camera(events_);
    }

    Clock& clock() override { return clock_; }
    std::unique_ptr<Camera> open() override {
        return open_camera(backend_.name == "v4l2" ? "v4l2:" + device_ : libcamera_id,
                           {.frame_timeout = std::chrono::seconds(2)},  // the guest is slow
                           clock_);
    }
    CaptureSettings settings() const override {
        return {.width = width,
                .height = height,
                .bits = bits_,
                .format = format_,
                .exposure = std::chrono::microseconds(backend_.sets_exposure ? 7000 : 0)};
    }
    std::vector<Refusal> refusals() const override {
        return {{"322", [](CaptureSettings& s) { s.width = 322; }},
                {"ABCD", [](CaptureSettings& s) { s.format = "ABCD"; }},
                {"gain", [](CaptureSettings& s) { s.gain_db = 70.0; }}};
    }
    bool show(const CodeImage& scene) override {
        const std::lock_guard lock(mutex_);
        scene_ = scene;
        return true;
    }
    bool unplug() override {
        camera_.unplug();
        return true;
    }
    bool plug_in() override {
        camera_.plug();
        device_ = next_camera(events_);
        return true;
    }

    UsbCamera& camera() { return camera_; }
    StreamMode mode() const { return {pixels_, {width, height}}; }

    // Of the latest frame; nothing before the first.
    std::optional<UsbExposure> last_exposure() const {
        const std::lock_guard lock(mutex_);
        return last_exposure_;
    }

private:
    static constexpr int width = 320, height = 200;
    // libcamera's name of the camera: its host controller (firmware_node.cpp), port and product.
    static constexpr const char* libcamera_id = "libcamera:virtual-1:1.0-1d6b:0102";

    // On the camera's thread. The scene's codes are the frame's, luma of yuyv; what else there is
    // stays the pattern's.
    std::vector<std::uint8_t> expose(const UsbExposure& exposure) {
        std::vector<std::uint8_t> frame = show_pattern(exposure);
        const std::lock_guard lock(mutex_);
        last_exposure_ = exposure;
        if (scene_.pixels.size() != exposure.mode.size)
            return frame;
        const int bytes = bytes_per_pixel(exposure.mode.pixels);
        if (static_cast<int>(scene_.pixels.elemSize()) == bytes) {
            scene_.pixels.copyTo(cv::Mat(exposure.mode.size, scene_.pixels.type(), frame.data()));
        } else {
            cv::Mat pairs(exposure.mode.size, CV_8UC2, frame.data());
            cv::insertChannel(scene_.pixels, pairs, 0);
        }
        return frame;
    }

    const UsbBackend backend_;
    const UsbPixels pixels_;
    const std::string format_;
    const int bits_;
    SteadyClock clock_;

    mutable std::mutex mutex_;
    CodeImage scene_;  // empty: the pattern
    std::optional<UsbExposure> last_exposure_;

    DeviceEvents events_{DeviceEvents::From::udev};
    UsbCamera camera_;
    std::string device_;
};

}  // namespace etalon
