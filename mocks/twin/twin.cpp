#include "mocks/twin/twin.h"

#include "stage/axes/kinematics.h"

namespace etalon {
namespace {

SimulatedStageOptions stage_options(const TwinFile& file) {
    SimulatedStageOptions options = file.stage.options;
    options.seed = file.seed;
    return options;
}

// A name for a new line, if the stage is on one.
std::optional<std::filesystem::path> line_of(const TwinStage& stage) {
    return stage.serial.empty() ? std::nullopt : std::optional(stage.serial);
}

}  // namespace

TwinRig::TwinRig(const TwinFile& file)
    : nominal_exposure_(file.nominal_exposure),
      stage_(file.stage.axes, stage_options(file), clock_),
      physics_(file.true_camera, file.scene, file.method, file.seed),
      image_source_([this](const std::vector<double>& q) { return develop(q); },
                    stage_.true_positions()),
      line_(line_of(file.stage)),
      server_(line_ ? ModbusStageServer(stage_, file.stage.profile, line_->pair())
                    : ModbusStageServer(stage_, file.stage.profile, file.stage.port)) {
    if (file.room)
        room_.emplace(file.room->room, clock_, file.room->port);
    server_.set_script(scripted_faults(file.stage.link_faults, stage_));
    stage_.hold_in_position_until(
        [this](const std::vector<double>& positions) { return image_source_.shows(positions); });
}

std::string TwinRig::stage_place() const {
    return line_ ? line_->path().string() : fmt::format("127.0.0.1:{}", stage_port());
}

Radiance TwinRig::develop(const std::vector<double>& positions) const {
    return physics_.radiance(base_from_carriage(stage_.axes(), positions));
}

double TwinRig::light(std::chrono::microseconds exposure, double gain_db) const {
    const double time = std::chrono::duration<double>(exposure) / nominal_exposure_;
    return time * std::pow(10.0, gain_db / 20.0);
}

}  // namespace etalon
