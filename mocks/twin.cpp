#include "mocks/twin.h"

#include <cmath>
#include <string>
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

GigeCameraOptions camera_options(const TwinFile& file) {
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

}  // namespace

Twin::Twin(const TwinFile& file)
    : nominal_exposure_(file.nominal_exposure),
      stage_(file.stage.axes, stage_options(file), clock_),
      physics_(file.true_camera, file.scene, file.method, file.seed),
      darkroom_([this](const std::vector<double>& q) { return develop(q); },
                stage_.true_positions()),
      server_(stage_, builtin_stage_profile(file.stage.profile), file.stage.port),
      camera_(camera_options(file), [this](const CaptureSettings& s) { return expose(s); }) {
    server_.set_script(scripted_faults(file.stage.link_faults, stage_));
    stage_.hold_in_position_until(
        [this](const std::vector<double>& positions) { return darkroom_.shows(positions); });
}

Twin::~Twin() = default;

Radiance Twin::develop(const std::vector<double>& positions) const {
    return physics_.radiance(base_from_carriage(stage_.axes(), positions));
}

// On the camera's thread. Light grows in proportion to the exposure time and with the gain in dB.
CodeImage Twin::expose(const CaptureSettings& settings) {
    const double time = std::chrono::duration<double>(settings.exposure) / nominal_exposure_;
    return physics_.expose(darkroom_.picture(), time * std::pow(10.0, settings.gain_db / 20.0),
                           frames_++);
}

}  // namespace etalon
