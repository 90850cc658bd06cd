// usb-camera [TWIN_FILE] [--sharpness N]: a camera on this kernel's virtual USB port until the
// program is ended, which pulls it out. It shows a pattern of which every byte is known or, given a
// twin.yaml, the marker on a stage that it also simulates. Only in the guest: see README.md.

#include <CLI/CLI.hpp>

#include "core/program/errors.h"
#include "mocks/ending_signals.h"
#include "tests/vm/device_events.h"
#include "tests/vm/test_pattern.h"
#include "tests/vm/usb_twin.h"

namespace {

constexpr int default_sharpness = 3, max_sharpness = 7;

int run(const std::filesystem::path& twin_file, int sharpness) {
    const sigset_t signals = etalon::block_ending_signals();
    etalon::DeviceEvents events(etalon::DeviceEvents::From::udev);
    std::unique_ptr<etalon::UsbTwin> twin;
    std::unique_ptr<etalon::UsbCamera> camera;
    if (twin_file.empty())
        camera = std::make_unique<etalon::UsbCamera>(
            etalon::UsbCameraOptions{.sharpness = sharpness}, etalon::show_pattern);
    else
        twin = std::make_unique<etalon::UsbTwin>(etalon::read_twin_file(twin_file), sharpness);
    fmt::print("camera {}\n", etalon::next_camera(events));
    fmt::print("ready\n");
    std::fflush(stdout);
    int signal = 0;
    sigwait(&signals, &signal);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    std::filesystem::path twin_file;
    int sharpness = default_sharpness;
    CLI::App app("A camera on the kernel's virtual USB port.");
    app.add_option("file", twin_file, "A twin.yaml: a stage, and what the camera sees of it");
    app.add_option("--sharpness", sharpness, "After power-up; 0 is neutral")
        ->check(CLI::Range(0, max_sharpness));
    CLI11_PARSE(app, argc, argv);
    try {
        return run(twin_file, sharpness);
    } catch (const etalon::Error& error) {
        fmt::print(stderr, "usb-camera: {}\n", error.what());
        return 4;
    }
}
