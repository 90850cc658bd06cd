#include "mocks/twin_rig.h"

#include <cmath>
#include <vector>

#include "stage/kinematics.h"
#include "stage/profile.h"

namespace etalon {
namespace {

SimulatedStageOptions stage_options(const TwinFile& file) {
    SimulatedStageOptions options = file.stage.options;
    options.seed = file.seed;
    return options;
}

}  // namespace

TwinRig::TwinRig(const TwinFile& file)
    : nominal_exposure_(file.nominal_exposure),
      stage_(file.stage.axes, stage_options(file), clock_),
      physics_(file.true_camera, file.scene, file.method, file.seed),
      darkroom_([this](const std::vector<double>& q) { return develop(q); },
                stage_.true_positions()),
      server_(stage_, builtin_stage_profile(file.stage.profile), file.stage.port) {
    server_.set_script(scripted_faults(file.stage.link_faults, stage_));
    stage_.hold_in_position_until(
        [this](const std::vector<double>& positions) { return darkroom_.shows(positions); });
}

Radiance TwinRig::develop(const std::vector<double>& positions) const {
    return physics_.radiance(base_from_carriage(stage_.axes(), positions));
}

double TwinRig::light(std::chrono::microseconds exposure, double gain_db) const {
    const double time = std::chrono::duration<double>(exposure) / nominal_exposure_;
    return time * std::pow(10.0, gain_db / 20.0);
}

}  // namespace etalon
