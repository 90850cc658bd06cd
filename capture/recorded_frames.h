// What a folder has to replay: the frames of a recorded run (etalon qualify, etalon capture) in the
// order in which they were taken, incomplete ones included, or any images in the order of their
// names.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/image.h"

namespace etalon {

struct RecordedFrame {
    std::filesystem::path path;  // empty unless the frame is complete
    FrameStatus status = FrameStatus::complete;
    std::string status_detail;
    std::uint64_t id = 0;  // the device's counter, or the image's number from 1
    // As recorded; of plain images nothing is known but what the file says.
    CaptureSettings settings;
    bool has_settings = false;
};

// A run's frames are those that its events.jsonl lists; without such a file all PNG, TIFF and JPEG
// images count, hidden ones excepted. Throws ConfigError, with the line of the log, when the folder
// or its log cannot be read or holds no frame.
std::vector<RecordedFrame> recorded_frames(const std::filesystem::path& folder);

}  // namespace etalon
