// Calibrations as COLMAP keeps them (cameras.txt): a line `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...`
// for every camera, lines that begin with # apart. Layout: COLMAP's "Output Format" and "Camera
// Models"; orders of parameters: its sensor/models.h.
//
// Read are SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV; fisheye models,
// FOV and THIN_PRISM_FISHEYE are refused by name.
#pragma once

#include <filesystem>
#include <string>

#include "calib/camera/camera_model.h"

namespace etalon {

// `id`: which camera ("3"); empty: the only one. Throws ConfigError with file, line and field.
CameraModel read_colmap_camera(const std::filesystem::path& path, const std::string& id = "");

// One camera with the id 1, as PINHOLE, OPENCV or FULL_OPENCV, the first that holds it. Throws
// ConfigError for coefficients that COLMAP does not have (s1..s4, tau_x, tau_y).
void write_colmap_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
