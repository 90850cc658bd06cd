// usb-camera [TWIN_FILE] [--sharpness N]: a camera on this kernel's virtual USB port until the
// program is ended, which pulls it out. It shows a pattern of which every byte is known or, given a
// twin.yaml, the marker on a stage that it also simulates. Only in the guest: see README.md.

#include <CLI/CLI.hpp>
#include <opencv2/imgproc.hpp>

#include "core/program/print_stderr.h"
#include "mocks/ending_signals.h"
#include "mocks/twin/twin.h"
#include "tests/vm/device_events.h"
#include "tests/vm/test_pattern.h"

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

// The twin with a USB camera: a stage over Modbus TCP on 127.0.0.1 and pictures that follow it, as
// in mocks/twin/twin.h, shown by a camera on this kernel's virtual USB port. It runs freely and is
// a consumer's: as it powers up, it chooses its own exposure and sharpens.
class UsbTwin {
public:
    // `sharpness` is the camera's after power-up, 0 to 7. Throws as TwinRig and UsbCamera do.
    UsbTwin(const TwinFile& file, int sharpness)
        : rig_(file), camera_(camera_options(file, sharpness), [this](const UsbExposure& exposure) {
              return expose(exposure);
          }) {}

private:
    // On the camera's thread.
    std::vector<std::uint8_t> expose(const UsbExposure& exposure) const {
        const double light =
            exposure.automatic ? automatic_exposure : rig_.light(exposure.time, exposure.gain_db);
        const Radiance picture = sharpened(rig_.picture(), exposure.sharpness);
        return bytes_of(rig_.physics().expose(picture, light, exposure.frame), exposure.mode);
    }

    TwinRig rig_;
    UsbCamera camera_;  // last: its thread uses the rig
};

constexpr int default_sharpness = 3, max_sharpness = 7;

int run(const std::filesystem::path& twin_file, int sharpness) {
    const sigset_t signals = block_ending_signals();
    DeviceEvents events(DeviceEvents::From::udev);
    std::unique_ptr<UsbTwin> twin;
    std::unique_ptr<UsbCamera> camera;
    if (twin_file.empty())
        camera =
            std::make_unique<UsbCamera>(UsbCameraOptions{.sharpness = sharpness}, show_pattern);
    else
        twin = std::make_unique<UsbTwin>(read_twin_file(twin_file), sharpness);
    fmt::print("camera {}\n", next_camera(events));
    fmt::print("ready\n");
    std::fflush(stdout);
    int signal = 0;
    sigwait(&signals, &signal);
    return 0;
}

}  // namespace
}  // namespace etalon

int main(int argc, char** argv) {
    using namespace etalon;
    std::filesystem::path twin_file;
    int sharpness = default_sharpness;
    CLI::App app("A camera on the kernel's virtual USB port.");
    app.add_option("file", twin_file, "A twin.yaml: a stage, and what the camera sees of it");
    app.add_option("--sharpness", sharpness, "After power-up; 0 is neutral")
        ->check(CLI::Range(0, max_sharpness));
    CLI11_PARSE(app, argc, argv);
    try {
        return run(twin_file, sharpness);
    } catch (const Error& error) {
        print_stderr("usb-camera: {}\n", error.what());
        return 4;
    }
}
