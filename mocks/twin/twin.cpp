#include "mocks/twin/twin.h"

namespace etalon {
namespace {

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
    : rig_(file),
      camera_(camera_options(file), [this](const CaptureSettings& s) { return expose(s); }) {}

// On the camera's thread.
CodeImage Twin::expose(const CaptureSettings& settings) {
    return rig_.physics().expose(rig_.picture(), rig_.light(settings.exposure, settings.gain_db),
                                 frames_++);
}

}  // namespace etalon
