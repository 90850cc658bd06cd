// The twin with a USB camera: a stage over Modbus TCP on 127.0.0.1, and a camera on this kernel's
// virtual USB port that shows the marker where the stage has it. As mocks/twin.h, but the camera
// runs freely and is a consumer's: as it powers up, it chooses its own exposure and sharpens.
#pragma once

#include "core/clock.h"
#include "mocks/darkroom.h"
#include "mocks/modbus_stage_server.h"
#include "mocks/simulated_stage.h"
#include "mocks/twin_file.h"
#include "sim/twin_physics.h"
#include "tests/vm/usb_camera.h"

namespace etalon {

class UsbTwin {
public:
    // `sharpness` is the camera's after power-up, 0 to 7. Throws as Twin and UsbCamera do.
    UsbTwin(const TwinFile& file, int sharpness);

    int stage_port() const { return server_.port(); }

private:
    Radiance develop(const std::vector<double>& positions) const;
    std::vector<std::uint8_t> expose(const UsbExposure& exposure) const;

    SteadyClock clock_;
    std::chrono::microseconds nominal_exposure_;
    SimulatedStage stage_;
    TwinPhysics physics_;
    Darkroom darkroom_;
    ModbusStageServer server_;
    UsbCamera camera_;  // last: it uses all the others
};

}  // namespace etalon
