// Calibrations as COLMAP keeps them (cameras.txt): a line `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...`
// for every camera, lines that begin with # apart. Layout: COLMAP's "Output Format" and "Camera
// Models"; orders of parameters: its sensor/models.h.
//
// Read are SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV, FOV,
// SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE and THIN_PRISM_FISHEYE.
#pragma once

#include <filesystem>
#include <string>

#include "calib/camera/camera_model.h"

namespace etalon {

// `id`: which camera ("3"); empty: the only one. Throws ConfigError with file, line and field.
CameraModel read_colmap_camera(const std::filesystem::path& path, const std::string& id = "");

// One camera with the id 1, as the first model with two focal lengths that holds it. Throws
// ConfigError for coefficients that COLMAP does not have there, and for a skew.
void write_colmap_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
