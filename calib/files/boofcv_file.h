// Calibrations as BoofCV writes them (YAML of its CalibrationIO): model, pinhole {width, height,
// fx, fy, skew, cx, cy} and radial_tangential {radial: [...], t1, t2}.
//
// Read and written are pinhole and pinhole_radial_tangential, whose radial, t1 and t2 are k1 k2 k3,
// p1 and p2 of OpenCV, omnidirectional_universal with the same, and kannala_brandt without its
// asymmetric terms: symmetric has the coefficients of theta, theta^3 to theta^9. Asymmetric terms
// (radial with radial_trig, tangent with tangent_trig) and stereo files are refused by name.
#pragma once

#include <filesystem>

#include "calib/camera/camera_model.h"

namespace etalon {

// Throws ConfigError with file, line and key.
CameraModel read_boofcv_camera(const std::filesystem::path& path);

// Throws ConfigError for coefficients beyond k1 k2 p1 p2 k3, of an equidistant camera k1 k2 k3 k7.
void write_boofcv_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
