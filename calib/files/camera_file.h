// A camera from a file and back. Our own camera.yml (`etalon: camera/1`, docs/files.md) carries
// everything that CameraModel has. Calibrations of other tools (calib/files/foreign_camera.h) are
// read as cameras without lens and sensor sections.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

// Reads ours or any other tool's, of any lens; the content tells which one it is.
//
// `image_size` is what the caller knows from elsewhere (a photo): it stands in where a foreign file
// gives no size, and must agree where the file does.
// f_number and working_f_number may both be given; they must agree to 1e-6.
// Throws ConfigError with file, line and key for everything that cannot be a camera.
CameraModel read_any_camera(const std::filesystem::path& path,
                            std::optional<cv::Size> image_size = std::nullopt);

// The same for callers that take perspective and telecentric lenses only: wider ones are a
// ConfigError that names them.
CameraModel read_camera(const std::filesystem::path& path,
                        std::optional<cv::Size> image_size = std::nullopt);

// Reading the written camera.yml gives the same doubles. A transfer table goes into a CSV of its
// own (camera.yml -> camera.transfer.csv), a measured point spread into camera.psf.yml. Throws
// ConfigError when a file cannot be written.
void write_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
