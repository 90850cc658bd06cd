// A USB Video Class camera whose pictures we choose, plugged into this kernel's virtual host
// controller: the kernel's own driver (uvcvideo) makes a /dev/video of it. It takes pictures
// freely, one after the other, each with the exposure time and gain that the client has set.
//
// Needs root and the modules vhci_hcd and uvcvideo. Not for timing: what counts is which bytes
// arrive, when their exposure began, and what happens when the camera fails.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <thread>

#include "core/time/clock.h"
#include "tests/vm/usb_video_device.h"

namespace etalon {

// One exposure, which makes one frame.
struct UsbExposure {
    StreamMode mode;
    std::uint32_t frame = 0;  // counts from 0 over the camera's life
    Instant start;            // the light is collected from here on
    std::chrono::microseconds time{0};
    double gain_db = 0.0;
    int sharpness = 0;       // 0: neutral
    bool automatic = false;  // the camera chooses the exposure time itself
};

class UsbCamera {
public:
    // The frame's bytes, of the mode's size. Called on the camera's thread after the exposure's
    // start; while it works, requests wait. Must not throw.
    using Source = std::function<std::vector<std::uint8_t>(const UsbExposure&)>;

    static constexpr const char* default_controller = "/sys/devices/platform/vhci_hcd.0";

    // Plugged in at once. Throws DeviceError as UsbPlug does.
    UsbCamera(UsbCameraOptions options, Source source,
              std::filesystem::path controller = default_controller);
    ~UsbCamera();
    UsbCamera(const UsbCamera&) = delete;
    UsbCamera& operator=(const UsbCamera&) = delete;

    // Pulls it out, in mid-stream or not; returns once the kernel has noticed. Plugged in again it
    // has forgotten all settings.
    void unplug();
    void plug();

    // Faults: the next frame ends in its middle; no frames until set free again.
    void truncate_next_frame();
    void freeze(bool frozen);

private:
    // What belongs to one plugging in; only the thread touches it.
    struct Session;

    void serve(Session& session);
    void wake();

    const UsbCameraOptions options_;
    const Source source_;
    const std::filesystem::path controller_;
    std::uint32_t frames_ = 0;  // only the thread touches it
    std::atomic<bool> pulled_{false}, truncate_next_{false}, frozen_{false};
    int wake_ = -1;  // an eventfd
    std::unique_ptr<Session> session_;
    std::thread thread_;
};

}  // namespace etalon
