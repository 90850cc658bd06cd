// Replays recorded images through the Camera interface: the PNG, TIFF and JPEG files of a folder,
// in the order of their names, one per frame_after(). Not a simulation: what was exposed when is
// not known, so a frame's exposure "begins" when it is asked for, and settings that a recording
// cannot obey are refused.
#pragma once

#include <filesystem>
#include <memory>

#include "capture/camera.h"

namespace etalon {

// Throws ConfigError when the folder cannot be read or has no image. The returned camera throws
// ConfigError for a file that is no readable image, and DeviceError after the last one, for one of
// another size than the first, or for settings that the recording does not have: another size or
// depth, an exposure other than 0 ("its own"), a gain other than 0.
std::unique_ptr<Camera> open_files_camera(const std::filesystem::path& folder, Clock& clock);

}  // namespace etalon
