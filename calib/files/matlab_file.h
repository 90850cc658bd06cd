// MATLAB's cameraParameters or cameraIntrinsics as JSON: jsonencode(toStruct(cameraParams)).
//
//   K [fx skew cx; 0 fy cy; 0 0 1], or IntrinsicMatrix, its transpose, or FocalLength [fx, fy],
//       PrincipalPoint [cx, cy] and Skew (which may be missing): at least one of them; those that
//       are there must agree
//   ImageSize          [rows, columns]; may be empty: the size is then not known
//   RadialDistortion   2 or 3 coefficients, k1 k2 k3
//   TangentialDistortion   p1 p2, OpenCV's; may be missing
//
// Names and orders: MATLAB's documentation of cameraParameters and cameraIntrinsics. Its principal
// point is 1-based. Fisheye parameters (MappingCoefficients) are refused by name.
#pragma once

#include <filesystem>

#include "calib/camera/camera_model.h"

namespace etalon {

// Width and height are 0 where the file gives none. Throws ConfigError with file, line and key.
CameraModel read_matlab_camera(const std::filesystem::path& path);

// For MATLAB:  s = jsondecode(fileread('camera.json'));
//   cameraIntrinsics(s.FocalLength', s.PrincipalPoint', s.ImageSize', Skew=s.Skew,
//       RadialDistortion=s.RadialDistortion', TangentialDistortion=s.TangentialDistortion')
// Throws ConfigError for coefficients beyond k1 k2 p1 p2 k3.
void write_matlab_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
