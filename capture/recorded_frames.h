// What a folder has to replay: the frames of a recorded run (etalon qualify, etalon capture) in the
// order in which they were taken, incomplete ones included, or any images in the order of their
// names.
#pragma once

#include <filesystem>
#include <vector>

#include "capture/frame/frame_log.h"

namespace etalon {

struct RecordedFrames {
    std::filesystem::path folder;
    // At least one. Of plain images the file is the only thing that is known; they are numbered
    // from 1.
    std::vector<FrameRecord> frames;
    bool are_logged = false;
};

// A run's frames are those that its events.jsonl lists; without such a file all PNG, TIFF and JPEG
// images count, hidden ones excepted. Throws ConfigError, with the line of the log, when the folder
// or its log cannot be read or holds no frame.
RecordedFrames recorded_frames(const std::filesystem::path& folder);

}  // namespace etalon
