// The twin: a stage controller on Modbus TCP or RTU and a camera that shows the marker where the
// simulated stage truly is. For a station under test it is like real devices; its camera may differ
// from the calibration.
//
//   station --Modbus--> stage --true positions--> image source (renders) --picture--> camera
//
// The stage reports "in position" once the new picture is finished: a frame exposed after a settled
// move shows it. While axes move the last picture stays.
#pragma once

#include "mocks/camera/gige_camera.h"
#include "mocks/camera/scene_image_source.h"
#include "mocks/stage/modbus_controller.h"
#include "mocks/twin/twin_file.h"

namespace etalon {

// What every twin has, whatever its camera.
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

    // What an exposure collects, proportional to time and gain; 1 at the nominal time and 0 dB.
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

// With a GigE Vision camera on 127.0.0.1. A frame's noise is a function of (seed, number, pixel).
class Twin : public TwinRig {
public:
    // Throws as TwinRig does, and DeviceError when the camera's port is taken.
    explicit Twin(const TwinFile& file) : TwinRig(file), camera_options_(camera_options(file)) {
        plug_camera_in(camera_options_.serial);
    }

    // For tests, which script its faults.
    GigeCamera& camera() { return *camera_; }

    // The camera is gone; another comes in its place. Not while another thread uses camera().
    void unplug_camera() { camera_.reset(); }
    void plug_camera_in(const std::string& serial) {
        camera_options_.serial = serial;
        camera_.emplace(camera_options_, [this](const CaptureSettings& s) {  // on its thread
            return physics().expose(picture(), light(s.exposure, s.gain_db), frames_++);
        });
    }

private:
    static GigeCameraOptions camera_options(const TwinFile& file) {
        const CameraModel& model = file.true_camera;
        GigeCameraOptions options;
        options.width = model.width;
        options.height = model.height;
        options.bits = model.sensor ? model.sensor->bits : 8;
        if (!model.serial.empty())
            options.serial = model.serial;
        options.packet_loss = file.packet_loss;
        return options;
    }

    std::atomic<std::uint32_t> frames_ = 0;
    GigeCameraOptions camera_options_;
    std::optional<GigeCamera> camera_;  // last: its thread uses all the others
};

}  // namespace etalon
