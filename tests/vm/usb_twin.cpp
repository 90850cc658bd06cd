#include "tests/vm/usb_twin.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "stage/kinematics.h"
#include "stage/profile.h"

namespace etalon {
namespace {

// What the camera's automatic aims at: radiance 1 at this part of full scale.
constexpr double automatic_exposure = 0.8;

SimulatedStageOptions stage_options(const TwinFile& file) {
    SimulatedStageOptions options = file.stage.options;
    options.seed = file.seed;
    return options;
}

UsbCameraOptions camera_options(const TwinFile& file, int sharpness) {
    UsbCameraOptions options;
    const CameraModel& model = file.true_camera;
    const bool deep = model.sensor && model.sensor->bits > 8;
    options.formats = {deep ? UsbPixels::y16 : UsbPixels::grey};
    options.sizes = {{model.width, model.height}};
    options.frames_per_second = 10;  // each costs the guest a sensor's noise
    options.sharpness = sharpness;
    return options;
}

// As cameras do it: what a blur would take away is added. Edges overshoot.
Radiance sharpened(const Radiance& picture, int sharpness) {
    if (sharpness == 0)
        return picture;
    Radiance blurred, out;
    cv::GaussianBlur(picture, blurred, {0, 0}, 1.5);
    const double amount = 0.2 * sharpness;
    cv::addWeighted(picture, 1.0 + amount, blurred, -amount, 0.0, out);
    return cv::max(out, 0.0);
}

std::vector<std::uint8_t> bytes_of(const CodeImage& image, const StreamMode& mode) {
    std::vector<std::uint8_t> out(mode.frame_bytes());
    cv::Mat frame(mode.size, bytes_per_pixel(mode.pixels) == 1 ? CV_8UC1 : CV_16UC1, out.data());
    image.pixels.copyTo(frame);
    return out;
}

}  // namespace

UsbTwin::UsbTwin(const TwinFile& file, int sharpness)
    : nominal_exposure_(file.nominal_exposure),
      stage_(file.stage.axes, stage_options(file), clock_),
      physics_(file.true_camera, file.scene, file.method, file.seed),
      darkroom_([this](const std::vector<double>& q) { return develop(q); },
                stage_.true_positions()),
      server_(stage_, builtin_stage_profile(file.stage.profile), file.stage.port),
      camera_(camera_options(file, sharpness), [this](const UsbExposure& e) { return expose(e); }) {
    stage_.hold_in_position_until(
        [this](const std::vector<double>& positions) { return darkroom_.shows(positions); });
}

Radiance UsbTwin::develop(const std::vector<double>& positions) const {
    return physics_.radiance(base_from_carriage(stage_.axes(), positions));
}

// On the camera's thread.
std::vector<std::uint8_t> UsbTwin::expose(const UsbExposure& exposure) const {
    const double time = std::chrono::duration<double>(exposure.time) / nominal_exposure_;
    const double light =
        exposure.automatic ? automatic_exposure : time * std::pow(10.0, exposure.gain_db / 20.0);
    const Radiance picture = sharpened(darkroom_.picture(), exposure.sharpness);
    return bytes_of(physics_.expose(picture, light, exposure.frame), exposure.mode);
}

}  // namespace etalon
