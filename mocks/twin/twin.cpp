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

Twin::Twin(const TwinFile& file) : TwinRig(file), camera_options_(camera_options(file)) {
    plug_camera_in(camera_options_.serial);
}

void Twin::plug_camera_in(const std::string& serial) {
    camera_options_.serial = serial;
    camera_.emplace(camera_options_, [this](const CaptureSettings& s) { return expose(s); });
}

// On the camera's thread.
CodeImage Twin::expose(const CaptureSettings& settings) {
    return physics().expose(picture(), light(settings.exposure, settings.gain_db), frames_++);
}

}  // namespace etalon
