// twin.yaml (`etalon: twin/1`): the virtual station's TRUE camera, stage and mounting, and how they
// differ from what the station under test is told. Relative paths are relative to the file.
//
//     etalon: twin/1
//     seed: 7                                   # of all noise
//     stage: {port: 1502, axes: [...], ...}     # see TwinStage
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
#include <vector>

#include "calib/camera/camera_model.h"
#include "mocks/stage/modbus_fault.h"
#include "mocks/stage/room_sensor_server.h"
#include "sim/render/renderer.h"
#include "sim/twin/twin_physics.h"
#include "stage/profile/profile.h"

namespace etalon {

// The `stage` section of twin.yaml: the TRUE stage, how it moves, errs and
// fails. Every key but axes and port or serial is optional. Of rotary axes `_um` and `_mm` are
// `_deg`.
//
//     stage:
//       port: 1502                       # Modbus TCP on 127.0.0.1; 0: any free one; or
//       serial: /tmp/stage               # Modbus RTU: a link to the line is made there
//       profile: generic                 # the controller it behaves as; built in or a file.yaml
//       axes: [...]                      # as in station.yaml, error maps too (stage/axes/axes.h)
//       ramp_ms: 50                      # from rest to an axis' speed
//       jerk_ms: 20                      # until its acceleration is there: S-curves; 0: trapezoids
//       homing_ms: 200                   # homing takes at least as long
//       temperature: {change_k: 2, time_constant_s: 1800}          # after power-on
//       servo:                           # by axis; without: it follows its plan exactly
//         x: {bandwidth_hz: 30, damping: 0.7, window_um: 5,        # "in position" in the window
//             drive_lag_us: 200, resonance_hz: 40, resonance_damping: 0.02}      # optional
//       errors:                          # by axis, each optional (0): AxisErrors
//         x: {scale_ppm: 0, repeatability_um: 0.5, backlash_um: 0, encoder_noise_um: 0.05,
//             periodic_um: 0.8, period_mm: 2, phase_deg: 0,
//             drift_um_per_k: 1.5, expansion_ppm_per_k: 11, lean_urad: {y: 150}}
//       faults:                          # once each; at: time_ms, move, request, register
//         - {fault: stuck_axis, axis: x, at: {move: 7}}
//         - {fault: false_in_position, axis: x, at: {move: 7}}
//         - {fault: encoder_jump, axis: x, at: {time_ms: 2500}, size_um: 20}
//         - {fault: limit_hit, axis: x, at: {move: 7}}
//         - {fault: alarm, axis: x, at: {move: 7}, code: 21}       # of its controller
//         - {fault: emergency_stop, at: {register: 200}}           # with the first write to it
//         - {fault: late_reply, at: {request: 120}, delay_ms: 400, requests: 3}  # three in a row
//         - {fault: slow_bytes, at: {request: 120}, delay_ms: 50}
//         - {fault: exception, at: {request: 120}, code: 4}
//         - {fault: silence, at: {request: 120}}      # as: garbage, wrong_id, half_open, reset;
//                                      # carried_out: false loses the request as well
struct TwinStage {
    int port = 0;                  // Modbus TCP
    std::filesystem::path serial;  // or Modbus RTU: where the link to the line is to be
    StageProfile profile = builtin_stage_profile("generic");
    std::vector<Axis> axes;         // their error maps are in the options
    SimulatedStageOptions options;  // but for the seed
    std::vector<ModbusFault> link_faults;
};

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

// Throw ConfigError with file, line and key. The section is of this file.
TwinStage read_twin_stage(const StrictFile& file, const Value& section);
TwinFile read_twin_file(const std::filesystem::path& path);

}  // namespace etalon
