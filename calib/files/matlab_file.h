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
// point is 1-based.
//
// fisheyeIntrinsics, jsonencode'd, or as Intrinsics of fisheyeParameters:
//
//   MappingCoefficients    [a0, a2, a3, a4], a0 positive; the projection `polynomial`, in px
//   DistortionCenter       [cx, cy], 1-based
//   StretchMatrix          [c d; e 1]; may be missing: no stretch
//   ImageSize              as above
//
// A point (u, v) of the image, less the centre and by the stretch's inverse, is (x, y) with
// r^2 = x^2 + y^2; its ray is (x, y, a0 + a2 r^2 + a3 r^3 + a4 r^4).
#pragma once

#include <filesystem>

#include "calib/camera/camera_model.h"

namespace etalon {

// Width and height are 0 where the file gives none. Throws ConfigError with file, line and key.
CameraModel read_matlab_camera(const std::filesystem::path& path);

// For MATLAB:  s = jsondecode(fileread('camera.json'));
//   cameraIntrinsics(s.FocalLength', s.PrincipalPoint', s.ImageSize', Skew=s.Skew,
//       RadialDistortion=s.RadialDistortion', TangentialDistortion=s.TangentialDistortion')
// and of a polynomial camera
//   fisheyeIntrinsics(s.MappingCoefficients', s.ImageSize', s.DistortionCenter', s.StretchMatrix)
// whose numbers read back within rounding errors.
// Throws ConfigError for coefficients beyond k1 k2 p1 p2 k3, of a polynomial camera any.
void write_matlab_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
