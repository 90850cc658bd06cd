#include "station/devices/capture_settings.h"

#include <fmt/format.h>

#include <cmath>

#include "capture/camera_recovery.h"
#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// "Gamma=0.7"
std::map<std::string, double> parse_controls(const std::vector<std::string>& words) {
    std::map<std::string, double> controls;
    for (const std::string& word : words) {
        const std::size_t equals = word.find('=');
        const auto value = equals == std::string::npos
                               ? std::nullopt
                               : parse_number(std::string_view(word).substr(equals + 1));
        if (!value || equals == 0)
            throw ConfigError({"--set"}, fmt::format("must be NAME=NUMBER, not '{}'", word));
        controls[word.substr(0, equals)] = *value;
    }
    return controls;
}

CameraLink camera_link(const CaptureArguments& arguments) {
    CameraLink link;
    link.packet_size = arguments.packet_size;
    link.frame_timeout = std::chrono::milliseconds(arguments.frame_timeout_ms);
    link.interface = arguments.interface;
    return link;
}

}  // namespace

CaptureSettings capture_settings(const CaptureArguments& arguments) {
    CaptureSettings settings;
    settings.width = arguments.width;
    settings.height = arguments.height;
    settings.format = arguments.format;
    settings.bits = arguments.bits.value_or(arguments.format.empty() ? 8 : 0);
    settings.exposure = std::chrono::microseconds(std::llround(arguments.exposure_us));
    settings.gain_db = arguments.gain_db;
    settings.black_level = arguments.black_level;
    settings.trigger = arguments.trigger;
    settings.controls = parse_controls(arguments.controls);
    return settings;
}

std::unique_ptr<Camera> opened_camera(const CaptureArguments& arguments, Clock& clock,
                                      const std::stop_token& stop) {
    return open_when_free(
        [&] { return open_camera(arguments.camera, camera_link(arguments), clock); }, clock, stop,
        [](const std::string& text) { fmt::print(stderr, "{}\n", text); });
}

}  // namespace etalon
