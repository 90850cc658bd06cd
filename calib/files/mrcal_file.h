// Calibrations as mrcal writes them (.cameramodel): a Python dictionary with lensmodel (once
// lens_model), intrinsics [fx, fy, cx, cy, distortion...], imagersize [width, height] and the
// camera's pose. Layout: mrcal's documentation "Camera model representation in memory and on disk"
// and its cameramodel.py.
//
// Read and written are LENSMODEL_PINHOLE and LENSMODEL_OPENCV4, 5, 8 and 12, whose coefficients are
// OpenCV's in OpenCV's order, LENSMODEL_STEREOGRAPHIC, _SPLINED_STEREOGRAPHIC and _CAHVOR, and
// _CAHVORE as far as its entrance pupil stays where it is (its last three numbers are 0). The pose
// and optimization_inputs are not read.
#pragma once

#include <filesystem>

#include "calib/camera/camera_model.h"

namespace etalon {

// Throws ConfigError with file, line and key.
CameraModel read_mrcal_camera(const std::filesystem::path& path);

// The first of these models that holds the camera, at the reference frame's origin. Throws
// ConfigError for tau_x and tau_y, a skew, distortion coefficients of other than OpenCV models, and
// a splined field of view that is no whole number of degrees.
void write_mrcal_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
