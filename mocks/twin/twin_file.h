// twin.yaml (`etalon: twin/1`): the virtual station's TRUE camera, stage and mounting. Relative
// paths are relative to the file. Every key: examples/every-key/twin.yaml.
#pragma once

#include "mocks/stage/room_sensor_server.h"
#include "sim/twin/twin_physics.h"
#include "stage/profile/profile.h"

namespace etalon {

// The `stage` section: the TRUE stage, how it moves, errs and fails.
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
