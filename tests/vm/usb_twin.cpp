#include "tests/vm/usb_twin.h"

#include <opencv2/imgproc.hpp>

namespace etalon {
namespace {

// What the camera's automatic aims at: radiance 1 at this part of full scale.
constexpr double automatic_exposure = 0.8;

UsbCameraOptions camera_options(const TwinFile& file, int sharpness) {
    const CameraModel& model = file.true_camera;
    const bool deep = model.sensor && model.sensor->bits > 8;
    return {.formats = {deep ? UsbPixels::y16 : UsbPixels::grey},
            .sizes = {{model.width, model.height}},
            .frames_per_second = 10,  // each costs the guest a sensor's noise
            .sharpness = sharpness};
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
    : rig_(file),
      camera_(camera_options(file, sharpness), [this](const UsbExposure& e) { return expose(e); }) {
}

// On the camera's thread.
std::vector<std::uint8_t> UsbTwin::expose(const UsbExposure& exposure) const {
    const double light =
        exposure.automatic ? automatic_exposure : rig_.light(exposure.time, exposure.gain_db);
    const Radiance picture = sharpened(rig_.picture(), exposure.sharpness);
    return bytes_of(rig_.physics().expose(picture, light, exposure.frame), exposure.mode);
}

}  // namespace etalon
