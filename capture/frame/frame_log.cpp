#include "capture/frame/frame_log.h"

#include <fmt/format.h>

#include <fstream>

namespace etalon {
namespace {

// The value up to `last` that has this name.
template <class Enum>
Enum value_named(const JsonEntry& entry, Enum last) {
    const std::string word = entry.text();
    for (int i = 0; i <= static_cast<int>(last); ++i)
        if (word == name(static_cast<Enum>(i)))
            return static_cast<Enum>(i);
    entry.fail(fmt::format("there is no '{}'", word));
}

double seconds(Duration duration) {
    return std::chrono::duration<double>(duration).count();
}

}  // namespace

LogLength read_log(const std::filesystem::path& folder,
                   const std::function<void(const JsonEntry& line)>& take) {
    const std::filesystem::path path = folder / log_file;
    std::ifstream file(path, std::ios::binary);
    if (!file)
        throw ConfigError({path.string()}, "cannot be read: is this the folder of a run?");
    LogLength length;
    std::string text;
    for (int line = 1; std::getline(file, text); ++line) {
        // getline() meets the end of the file only where the line has no end of its own.
        if (file.eof() || text.find('\0') != std::string::npos) {
            length.broken_bytes = std::filesystem::file_size(path) - length.whole_bytes;
            break;
        }
        take(JsonEntry(text, {path.string(), line, ""}));
        length.whole_bytes += text.size() + 1;
    }
    return length;
}

FrameRecord frame_record(const Frame& frame, Instant start) {
    return {.file = {},
            .sha256 = {},
            .status = frame.status,
            .status_detail = frame.status_detail,
            .device_id = frame.id,
            .exposure_start_s = seconds(frame.exposure_start - start),
            .exposure_start_uncertainty_s = seconds(frame.exposure_start_uncertainty),
            .time_source = frame.time_source,
            .device_time_ns = frame.device_time_ns,
            .settings = frame.settings,
            .corners = {},
            .detection = {}};
}

FrameRecord read_frame_record(const JsonEntry& line) {
    line.require_keys({"t", "event", "pose", "file", "sha256", "status", "status_detail",
                       "device_id", "exposure_start_uncertainty_s", "time_source", "device_time_ns",
                       "settings", "detection", "corners"});
    FrameRecord frame;
    frame.file = line.at("file").text();
    frame.sha256 = line.at("sha256").text();
    frame.status = value_named(line.at("status"), FrameStatus::timed_out);
    frame.status_detail = line.at("status_detail").text();
    frame.device_id = line.at("device_id").whole();
    frame.exposure_start_s = line.at("t").number(units::s.either_sign());
    frame.exposure_start_uncertainty_s =
        line.at("exposure_start_uncertainty_s").number(units::s.non_negative());
    frame.time_source = value_named(line.at("time_source"), TimeSource::recording);
    frame.device_time_ns = line.at("device_time_ns").whole();
    frame.settings = read_settings(line.at("settings"));
    return frame;
}

CaptureSettings read_settings(const JsonEntry& entry) {
    constexpr long long most = std::numeric_limits<int>::max();
    entry.require_keys({"width", "height", "bits", "format", "exposure_us", "gain_db",
                        "black_level", "trigger", "controls"});
    CaptureSettings settings;
    settings.width = static_cast<int>(entry.at("width").integer(0, most));
    settings.height = static_cast<int>(entry.at("height").integer(0, most));
    settings.bits = static_cast<int>(entry.at("bits").integer(0, 16));
    settings.format = entry.at("format").text();
    settings.exposure = std::chrono::microseconds(entry.at("exposure_us").integer(0, most));
    settings.gain_db = entry.at("gain_db").number();
    if (!entry.at("black_level").is_null())
        settings.black_level = entry.at("black_level").number();
    settings.trigger = entry.at("trigger").text();
    if (const JsonEntry controls = entry.at("controls"); !controls.is_null())
        for (const std::string& key : controls.keys())
            settings.controls[key] = controls.at(key.c_str()).number();
    return settings;
}

}  // namespace etalon
