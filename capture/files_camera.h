// Replays recorded frames, one per frame_after(): those of a record (etalon qualify, etalon
// capture) with their statuses, counters and settings, or the images of a folder by name. An
// exposure "begins" when it is asked for, and a bad frame is not taken again.
#pragma once

#include "capture/frame/camera.h"
#include "capture/frame/frame_log.h"

namespace etalon {

// Throws ConfigError when the folder cannot be read or has no frame. The camera throws ConfigError
// for an unreadable image, DeviceError after the last one, for another size than the first's, and
// for settings that the recording does not have; exposure and gain 0 are the recording's own.
std::unique_ptr<Camera> open_files_camera(const std::filesystem::path& folder, Clock& clock);

// The frames of a recorded run in their order, incomplete ones included, or images by name.
struct RecordedFrames {
    std::filesystem::path folder;
    // At least one. Of plain images only the file is known; they are numbered from 1.
    std::vector<FrameRecord> frames;
    bool are_logged = false;
};

// Of a run those in its events.jsonl; otherwise all PNG, TIFF and JPEG images but hidden ones.
// Throws ConfigError, with the line of the log, for what cannot be read or holds no frame.
RecordedFrames recorded_frames(const std::filesystem::path& folder);

}  // namespace etalon
