// What a camera's file says, as one hash: for folders whose content follows from it.
#pragma once

#include <filesystem>
#include <string>

#include "calib/camera/camera_model.h"

namespace etalon {

// SHA-256 of the file, and of the tables in other files that it names: those as they were read into
// `camera`. Throws ConfigError when the file cannot be read.
std::string camera_sha256(const std::filesystem::path& file, const CameraModel& camera);

}  // namespace etalon
