#include "capture/recorded_frames.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

#include "core/program/errors.h"

namespace etalon {
namespace {

namespace fs = std::filesystem;

bool is_image_name(const fs::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    constexpr std::array<std::string_view, 5> known{".png", ".tif", ".tiff", ".jpg", ".jpeg"};
    return std::find(known.begin(), known.end(), extension) != known.end();
}

// The folder's images in the order of their names; hidden files are none.
std::vector<FrameRecord> images_in(const fs::path& folder) {
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
    std::vector<FrameRecord> frames;
    for (const fs::path& path : paths) {
        FrameRecord frame;
        frame.file = frame.status_detail = path.filename().string();
        frame.status = FrameStatus::complete;
        frame.device_id = frames.size() + 1;
        frames.push_back(frame);
    }
    return frames;
}

// A file outside the record's folder is none of it.
FrameRecord frame_inside(const JsonEntry& line) {
    FrameRecord frame = read_frame_record(line);
    if (frame.status != FrameStatus::complete)
        frame.file.clear();
    const fs::path file = fs::path(frame.file).lexically_normal();
    if (file.is_absolute() || (!file.empty() && *file.begin() == ".."))
        line.at("file").fail("the frame " + frame.file + " lies outside the record");
    return frame;
}

// A frame is logged before its image is on the disk: where that was full or the machine went down,
// the images of the last ones are missing.
void leave_out_unwritten_end(const fs::path& folder, std::vector<FrameRecord>& frames) {
    const auto written = [&](const FrameRecord& frame) {
        std::error_code ignored;
        return !frame.file.empty() && fs::exists(folder / frame.file, ignored);
    };
    const auto after_the_last = std::find_if(frames.rbegin(), frames.rend(), written).base();
    const auto first_missing = std::find_if(
        after_the_last, frames.end(), [](const FrameRecord& frame) { return !frame.file.empty(); });
    frames.erase(first_missing, frames.end());
}

std::vector<FrameRecord> frames_in_log(const fs::path& folder) {
    std::vector<FrameRecord> frames;
    read_log(folder, [&](const JsonEntry& line) {
        if (line.at("event").text() == "frame")
            frames.push_back(frame_inside(line));
    });
    leave_out_unwritten_end(folder, frames);
    if (frames.empty())
        throw ConfigError({(folder / log_file).string()}, "lists no frame whose image is there");
    return frames;
}

}  // namespace

RecordedFrames recorded_frames(const fs::path& folder) {
    std::error_code ignored;
    const bool are_logged = fs::is_regular_file(folder / log_file, ignored);
    return {folder, are_logged ? frames_in_log(folder) : images_in(folder), are_logged};
}

}  // namespace etalon
