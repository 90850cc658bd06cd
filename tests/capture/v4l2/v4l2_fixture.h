// A scripted V4L2 device (tests/fakes/fake_v4l2.h) and the camera over it.
#pragma once

#include "capture/v4l2/v4l2_camera.h"
#include "tests/fakes/fake_v4l2.h"

namespace etalon {

class V4l2 : public testing::Test {
protected:
    V4l2() { clock_.advance(std::chrono::hours(1)); }

    std::unique_ptr<Camera> open() { return open_v4l2_camera("/dev/video0", {}, clock_, device_); }

    std::unique_ptr<Camera> armed() {
        auto camera = open();
        camera->configure(settings_);
        camera->arm();
        return camera;
    }

    Frame frame(Camera& camera, int retries = 0) {
        return camera.frame_after(clock_.now(), retries, {});
    }

    std::string configure_error(const CaptureSettings& settings) {
        return device_error_of([&] { open()->configure(settings); });
    }

    // From the next frame that surely counts as new on, as this does.
    void spoil_from_now(std::function<void(FakeV4l2Frame&)> spoil) {
        const Instant from = clock_.now() + 3 * device_.period - device_.readout;
        device_.spoil = [=](FakeV4l2Frame& frame) {
            if (frame.exposure_start > from)
                spoil(frame);
        };
    }

    VirtualClock clock_;
    FakeV4l2 device_{clock_};
    CaptureSettings settings_{
        .width = 17, .height = 11, .exposure = std::chrono::microseconds(7000)};
};

}  // namespace etalon
