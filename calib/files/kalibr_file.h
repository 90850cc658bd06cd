// Calibrations as Kalibr writes them (camchain.yaml): for every camera cam0, cam1, ... its
// camera_model, intrinsics [fu, fv, pu, pv], distortion_model, distortion_coeffs and resolution
// [width, height]. Layout: the wiki of Kalibr, "yaml formats".
//
// Read and written are camera_model pinhole with the distortion radtan (k1 k2 p1 p2, OpenCV's
// order), equidistant, fov or none, omni with radtan or none, eucm and ds. Poses between cameras
// and the IMU are not read.
#pragma once

#include <filesystem>
#include <string>

#include "calib/camera/camera_model.h"

namespace etalon {

// `name`: which camera ("cam1"); empty: the only one. Throws ConfigError with file, line and key.
CameraModel read_kalibr_camera(const std::filesystem::path& path, const std::string& name = "");

// One camera, cam0. Throws ConfigError for coefficients beyond k1 k2 p1 p2 (equidistant k1 k2 k3
// k7), and for a skew.
void write_kalibr_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
