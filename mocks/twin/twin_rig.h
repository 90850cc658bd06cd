// What every twin has, whatever its camera: a stage controller on Modbus TCP or RTU, and pictures
// of the marker where the simulated stage truly is.
//
//   station --Modbus--> stage --true positions--> image source (renders) --picture--> camera
//
// The stage reports "in position" only once the picture of the new position is finished, so every
// frame that is exposed after a settled move shows it. While axes move the last picture stays on
// show.
#pragma once

#include <chrono>
#include <optional>
#include <string>

#include "core/time/clock.h"
#include "mocks/camera/scene_image_source.h"
#include "mocks/stage/modbus_controller.h"
#include "mocks/twin/twin_file.h"
#include "sim/twin/twin_physics.h"

namespace etalon {

class TwinRig {
public:
    // Renders the first picture, then listens. Throws DeviceError when the port or the serial
    // line's name is taken, ConfigError for what the parts cannot be.
    explicit TwinRig(const TwinFile& file);

    int stage_port() const { return server_.port(); }  // the bound one; 0: a serial line
    std::string stage_place() const;                   // "127.0.0.1:1502" or the serial line's name
    int room_port() const { return room_ ? room_->port() : 0; }  // of the room's sensor; 0: none
    SimulatedStage& stage() { return stage_; }
    const TwinPhysics& physics() const { return physics_; }
    Radiance picture() const { return image_source_.picture(); }  // safe from every thread

    // What such an exposure collects, 1 at the nominal exposure time and 0 dB. Light grows in
    // proportion to the time and with the gain.
    double light(std::chrono::microseconds exposure, double gain_db) const;

private:
    Radiance develop(const std::vector<double>& positions) const;

    SteadyClock clock_;
    std::chrono::microseconds nominal_exposure_;
    SimulatedStage stage_;
    TwinPhysics physics_;
    SceneImageSource image_source_;
    std::optional<SerialLink> line_;
    std::optional<RoomSensorServer> room_;
    ModbusStageServer server_;  // last: its thread uses all the others
};

}  // namespace etalon
