#include "tests/vm/usb_rig.h"

#include "tests/vm/test_pattern.h"

namespace etalon {
namespace {

constexpr int width = 320, height = 200;
// libcamera's name of the camera: its host controller (firmware_node.cpp), port and product.
constexpr const char* libcamera_id = "libcamera:virtual-1:1.0-1d6b:0102";

}  // namespace

UsbRig::UsbRig(UsbBackend backend, UsbPixels pixels, std::string format, int bits)
    : backend_(std::move(backend)),
      pixels_(pixels),
      format_(std::move(format)),
      bits_(bits),
      camera_({.sizes = {{640, 480}, {width, height}}, .frames_per_second = 60},
              [this](const UsbExposure& exposure) { return expose(exposure); }) {
    device_ = next_camera(events_);
}

std::unique_ptr<Camera> UsbRig::open() {
    return open_camera(backend_.name == "v4l2" ? "v4l2:" + device_ : libcamera_id,
                       {.frame_timeout = std::chrono::seconds(2)},  // the guest is slow
                       clock_);
}

CaptureSettings UsbRig::settings() const {
    return {.width = width,
            .height = height,
            .bits = bits_,
            .format = format_,
            .exposure = std::chrono::microseconds(backend_.sets_exposure ? 7000 : 0)};
}

std::vector<CameraRig::Refusal> UsbRig::refusals() const {
    return {{"322", [](CaptureSettings& s) { s.width = 322; }},
            {"ABCD", [](CaptureSettings& s) { s.format = "ABCD"; }},
            {"gain", [](CaptureSettings& s) { s.gain_db = 70.0; }}};
}

StreamMode UsbRig::mode() const {
    return {pixels_, {width, height}};
}

bool UsbRig::show(const CodeImage& scene) {
    const std::lock_guard lock(mutex_);
    scene_ = scene;
    return true;
}

bool UsbRig::unplug() {
    camera_.unplug();
    return true;
}

bool UsbRig::plug_in() {
    camera_.plug();
    device_ = next_camera(events_);
    return true;
}

std::optional<UsbExposure> UsbRig::last_exposure() const {
    const std::lock_guard lock(mutex_);
    return last_exposure_;
}

// On the camera's thread. The scene's codes are the frame's, luma of yuyv; what else there is stays
// the pattern's.
std::vector<std::uint8_t> UsbRig::expose(const UsbExposure& exposure) {
    std::vector<std::uint8_t> frame = show_pattern(exposure);
    const std::lock_guard lock(mutex_);
    last_exposure_ = exposure;
    if (scene_.pixels.size() != exposure.mode.size)
        return frame;
    const int bytes = bytes_per_pixel(exposure.mode.pixels);
    if (static_cast<int>(scene_.pixels.elemSize()) == bytes) {
        scene_.pixels.copyTo(cv::Mat(exposure.mode.size, scene_.pixels.type(), frame.data()));
    } else {
        cv::Mat pairs(exposure.mode.size, CV_8UC2, frame.data());
        cv::insertChannel(scene_.pixels, pairs, 0);
    }
    return frame;
}

}  // namespace etalon
