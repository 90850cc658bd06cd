// The twin: a stage controller on Modbus TCP or RTU and a GigE Vision camera on 127.0.0.1, whose
// pictures show the marker where the simulated stage truly is (twin_rig.h). A station under test
// cannot tell it from devices, except that the camera it was calibrated for may be another one.
// Each frame has its own noise, a pure function of (seed, frames before it, pixel).
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>

#include "mocks/camera/gige_camera.h"
#include "mocks/twin/twin_rig.h"

namespace etalon {

class Twin : public TwinRig {
public:
    // Throws as TwinRig does, and DeviceError when the camera's port is taken.
    explicit Twin(const TwinFile& file);

    // For tests, which script its faults.
    GigeCamera& camera() { return *camera_; }

    // The camera is gone; another comes in its place. Not while another thread uses camera().
    void unplug_camera() { camera_.reset(); }
    void plug_camera_in(const std::string& serial);

private:
    CodeImage expose(const CaptureSettings& settings);

    std::atomic<std::uint32_t> frames_ = 0;
    GigeCameraOptions camera_options_;
    std::optional<GigeCamera> camera_;  // last: its thread uses all the others
};

}  // namespace etalon
