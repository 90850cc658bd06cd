#include "capture/recorded_frames.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string_view>

#include "core/errors.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

bool is_image_name(const fs::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    constexpr std::array<std::string_view, 5> known{".png", ".tif", ".tiff", ".jpg", ".jpeg"};
    return std::find(known.begin(), known.end(), extension) != known.end();
}

// The folder's images in the order of their names; hidden files are none.
std::vector<RecordedFrame> images_in(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> paths;
    fs::directory_iterator entries(folder, error);
    for (; !error && entries != fs::directory_iterator(); entries.increment(error)) {
        const fs::path& path = entries->path();
        if (is_image_name(path) && path.filename().string().front() != '.')
            paths.push_back(path);
    }
    if (error)
        throw ConfigError({folder.string()}, "cannot be read: " + error.message());
    if (paths.empty())
        throw ConfigError({folder.string()}, "holds no PNG, TIFF or JPEG image");
    std::sort(paths.begin(), paths.end());
    std::vector<RecordedFrame> frames;
    for (const fs::path& path : paths) {
        RecordedFrame frame;
        frame.path = path;
        frame.id = frames.size() + 1;
        frames.push_back(frame);
    }
    return frames;
}

FrameStatus status_named(const std::string& word) {
    for (const FrameStatus status :
         {FrameStatus::complete, FrameStatus::short_frame, FrameStatus::corrupt, FrameStatus::lost,
          FrameStatus::timed_out})
        if (word == name(status))
            return status;
    throw ConfigError({}, "no frame has the status " + word);
}

CaptureSettings recorded_settings(const json& event) {
    CaptureSettings settings;
    settings.width = event.at("width");
    settings.height = event.at("height");
    settings.bits = event.at("bits");
    settings.exposure = std::chrono::microseconds(event.at("exposure_us").get<long long>());
    settings.gain_db = event.at("gain_db");
    settings.format = event.value("format", "");
    return settings;
}

// A file outside the record's folder is none of it.
fs::path inside(const fs::path& folder, const std::string& file) {
    const fs::path relative = fs::path(file).lexically_normal();
    if (relative.is_absolute() || (!relative.empty() && *relative.begin() == ".."))
        throw ConfigError({}, "the frame " + file + " lies outside the record");
    return folder / relative;
}

RecordedFrame frame_of(const json& event, const fs::path& folder) {
    RecordedFrame frame;
    frame.status = status_named(event.at("status"));
    frame.status_detail = event.at("status_detail");
    frame.id = event.at("device_id");
    frame.settings = recorded_settings(event.at("settings"));
    frame.has_settings = true;
    if (frame.status == FrameStatus::complete)
        frame.path = inside(folder, event.at("file"));
    return frame;
}

// A frame is logged before its image is on the disk: where that was full or the machine went down,
// the images of the last ones are missing.
void leave_out_unwritten_end(std::vector<RecordedFrame>& frames) {
    const auto written = [](const RecordedFrame& frame) {
        std::error_code ignored;
        return !frame.path.empty() && fs::exists(frame.path, ignored);
    };
    const auto after_the_last = std::find_if(frames.rbegin(), frames.rend(), written).base();
    const auto first_missing =
        std::find_if(after_the_last, frames.end(),
                     [](const RecordedFrame& frame) { return !frame.path.empty(); });
    frames.erase(first_missing, frames.end());
}

// The log's last line may be half there when the machine went down; a line before it may not.
std::vector<RecordedFrame> frames_in_log(const fs::path& folder, const fs::path& log) {
    std::ifstream lines(log);
    std::vector<RecordedFrame> frames;
    std::string line;
    for (int number = 1; std::getline(lines, line); ++number) {
        try {
            const json event = json::parse(line);
            if (event.at("event") == "frame")
                frames.push_back(frame_of(event, folder));
        } catch (const json::exception& error) {
            if (lines.peek() == std::ifstream::traits_type::eof())
                break;
            throw ConfigError({log.string(), number}, error.what());
        } catch (const ConfigError& error) {
            throw ConfigError({log.string(), number}, error.what());
        }
    }
    leave_out_unwritten_end(frames);
    if (frames.empty())
        throw ConfigError({log.string()}, "lists no frame whose image is there");
    return frames;
}

}  // namespace

std::vector<RecordedFrame> recorded_frames(const fs::path& folder) {
    const fs::path log = folder / "events.jsonl";
    std::error_code ignored;
    return fs::is_regular_file(log, ignored) ? frames_in_log(folder, log) : images_in(folder);
}

}  // namespace etalon
