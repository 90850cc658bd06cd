// The twin: a stage controller on Modbus TCP and a GigE Vision camera, both on 127.0.0.1, whose
// pictures show the marker where the simulated stage truly is. A station under test cannot tell it
// from devices, except that the camera it was calibrated for may be another one.
//
//   station --Modbus--> stage --true positions--> darkroom (renders) --picture--> camera --GVSP-->
//
// The stage reports "in position" only once the picture of the new position is finished, so every
// frame that is triggered after a settled move shows it. While axes move the last picture stays on
// show. Each frame has its own noise, a pure function of (seed, frames before it, pixel).
#pragma once

#include <atomic>
#include <cstdint>

#include "core/clock.h"
#include "mocks/darkroom.h"
#include "mocks/gige_camera.h"
#include "mocks/modbus_stage_server.h"
#include "mocks/simulated_stage.h"
#include "mocks/twin_file.h"
#include "sim/twin_physics.h"

namespace etalon {

class Twin {
public:
    // Renders the first picture, then listens. Throws DeviceError when a port is taken, ConfigError
    // for what the parts cannot be.
    explicit Twin(const TwinFile& file);
    ~Twin();

    int stage_port() const { return server_.port(); }  // the bound one

    // The parts, for tests: to script faults, and to know the truth.
    SimulatedStage& stage() { return stage_; }
    const TwinPhysics& physics() const { return physics_; }
    Radiance picture() const { return darkroom_.picture(); }

private:
    Radiance develop(const std::vector<double>& positions) const;
    CodeImage expose(const CaptureSettings& settings);

    SteadyClock clock_;
    std::chrono::microseconds nominal_exposure_;
    SimulatedStage stage_;
    TwinPhysics physics_;
    Darkroom darkroom_;
    std::atomic<std::uint32_t> frames_ = 0;
    // Last: their threads use all the others.
    ModbusStageServer server_;
    GigeCamera camera_;
};

}  // namespace etalon
