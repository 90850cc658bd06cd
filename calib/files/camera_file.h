// A camera from a file and back: our camera.yml (`etalon: camera/1`, docs/files.md), which carries
// all of CameraModel, and other tools' (foreign_camera.h), without lens and sensor sections.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

// Reads any tool's, of any lens; the content tells which. `image_size` stands in where a foreign
// file gives none, and must agree where it does. f_number and working_f_number must agree to 1e-6.
// Throws ConfigError with file, line and key for everything that cannot be a camera.
CameraModel read_any_camera(const std::filesystem::path& path,
                            std::optional<cv::Size> image_size = std::nullopt);

// The same for perspective and telecentric lenses only: wider ones are a ConfigError.
CameraModel read_camera(const std::filesystem::path& path,
                        std::optional<cv::Size> image_size = std::nullopt);

// Reading gives the same doubles. A transfer table goes into a CSV (camera.yml ->
// camera.transfer.csv), a measured point spread into camera.psf.yml. Throws ConfigError.
void write_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
