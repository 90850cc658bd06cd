// Replays recorded frames through the Camera interface: those of a record (etalon qualify, etalon
// capture) with the statuses, counters and settings that they had, or the PNG, TIFF and JPEG files
// of a folder in the order of their names; one per frame_after(). Not a simulation: a frame's
// exposure "begins" when it is asked for, a bad one is not triggered again, and settings that a
// recording cannot obey are refused.
#pragma once

#include <filesystem>
#include <memory>

#include "capture/frame/camera.h"

namespace etalon {

// Throws ConfigError when the folder cannot be read or has no frame. The returned camera throws
// ConfigError for a file that is no readable image, and DeviceError after the last one, for one of
// another size than the first, or for settings that the recording does not have: another size or
// depth, format, black level, trigger or control, and an exposure or gain other than 0 ("its own")
// and the recorded one.
std::unique_ptr<Camera> open_files_camera(const std::filesystem::path& folder, Clock& clock);

}  // namespace etalon
