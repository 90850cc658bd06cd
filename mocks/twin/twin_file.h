// twin.yaml (`etalon: twin/1`): the virtual station's TRUE camera, stage and mounting, and how they
// differ from what the station under test is told. Relative paths are relative to the file.
//
//     etalon: twin/1
//     seed: 7                                   # of all noise
//     stage: {port: 1502, axes: [...], ...}     # mocks/twin/twin_stage_file.h
//     camera:
//       calibration: camera.yml                 # what the station is told
//       errors: {focal_length_percent: 0, k1_percent: 0, principal_point_px: [0, 0]}   # optional
//       nominal_exposure_us: 5000               # with which radiance 1 is full scale
//       method: auto                            # of rendering: auto or reference; optional
//       packet_loss: 0                          # part of the stream's packets; optional
//     scene:
//       marker: "apriltag:36h11:5@50mm"
//       background: 0.6
//       camera_from_base: {rotation_deg: [0, 0, 0], translation_mm: [0, 0, 300]}
//       carriage_from_marker: {rotation_deg: [0, 0, 0], translation_mm: [0, 0, 0]}
//     room: {port: 1503, temperature_c: 20.3, swing_k: 0.1, period_s: 60, humidity_percent: 45}
//                                               # a sensor (mocks/stage/room_sensor_server.h);
//                                               optional
//
// rotation_deg is a rotation vector: axis times angle.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>

#include "calib/camera/camera_model.h"
#include "mocks/stage/room_sensor_server.h"
#include "mocks/twin/twin_stage_file.h"
#include "sim/render/renderer.h"
#include "sim/twin/twin_physics.h"

namespace etalon {

struct TwinRoom {
    int port = 0;  // of its sensor; 0: any free one
    SimulatedRoom room;
};

struct TwinFile {
    std::uint64_t seed = 0;

    TwinStage stage;

    CameraModel true_camera;  // errors applied
    std::chrono::microseconds nominal_exposure{0};
    RenderMethod method = RenderMethod::automatic;
    double packet_loss = 0.0;

    TwinScene scene;
    std::optional<TwinRoom> room;
};

// Throws ConfigError with file, line and key.
TwinFile read_twin_file(const std::filesystem::path& path);

}  // namespace etalon
