// Replays recorded frames through the Camera interface: those of a record (etalon qualify, etalon
// capture) with the statuses, counters and settings that they had, or the PNG, TIFF and JPEG files
// of a folder in the order of their names; one per frame_after(). Not a simulation: a frame's
// exposure "begins" when it is asked for, a bad one is not triggered again, and settings that a
// recording cannot obey are refused.
#pragma once

#include "capture/frame/camera.h"
#include "capture/frame/frame_log.h"

namespace etalon {

// Throws ConfigError when the folder cannot be read or has no frame. The returned camera throws
// ConfigError for a file that is no readable image, and DeviceError after the last one, for one of
// another size than the first, or for settings that the recording does not have: another size or
// depth, format, black level, trigger or control, and an exposure or gain other than 0 ("its own")
// and the recorded one.
std::unique_ptr<Camera> open_files_camera(const std::filesystem::path& folder, Clock& clock);

// What a folder has to replay: the frames of a recorded run (etalon qualify, etalon capture) in the
// order in which they were taken, incomplete ones included, or any images in the order of their
// names.

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
