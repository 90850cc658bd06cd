// The USB camera behind one of the product's backends, for the contract that every backend keeps
// (tests/capture/frame/camera_contract.h) and for tests of what only a real driver does.
#pragma once

#include "tests/capture/frame/camera_contract.h"
#include "tests/vm/device_events.h"
#include "tests/vm/usb_camera.h"

namespace etalon {

// How a backend names the camera and its formats, and what it can set.
struct UsbBackend {
    std::string name;  // "v4l2" or "libcamera"
    bool sets_exposure = false;
};

class UsbRig : public CameraRig {
public:
    // `format` is the backend's name for `pixels`; `bits` is what it makes of them.
    UsbRig(UsbBackend backend, UsbPixels pixels, std::string format, int bits);

    Clock& clock() override { return clock_; }
    std::unique_ptr<Camera> open() override;
    CaptureSettings settings() const override;
    std::vector<Refusal> refusals() const override;
    bool show(const CodeImage& scene) override;
    bool unplug() override;
    bool plug_in() override;

    UsbCamera& camera() { return camera_; }
    StreamMode mode() const;

    // Of the latest frame; nothing before the first.
    std::optional<UsbExposure> last_exposure() const;

private:
    std::vector<std::uint8_t> expose(const UsbExposure& exposure);

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
