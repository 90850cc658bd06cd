// Calibrations as ROS keeps them (camera_info YAML, as written by camera_calibration): image_width,
// image_height, camera_matrix, distortion_model and distortion_coefficients. Models: plumb_bob (5
// coefficients) and rational_polynomial (8), whose order is OpenCV's, and equidistant (4); others
// are refused by name, and so is a skew.
// Rectification and projection matrices describe a rectified image and are not read.
//
// Pixel (0, 0) is the centre of the top-left pixel there too.
#pragma once

#include <filesystem>

#include "calib/camera/camera_model.h"

namespace etalon {

// Throws ConfigError with file, line and key.
CameraModel read_ros_camera(const std::filesystem::path& path);

// plumb_bob if it holds the coefficients, else rational_polynomial; no rectification, and the
// camera matrix as the projection. Throws ConfigError for s1..s4, tau_x and tau_y.
void write_ros_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
