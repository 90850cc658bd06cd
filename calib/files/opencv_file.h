// Calibrations as OpenCV's programs write them: YAML, XML or JSON of cv::FileStorage.
//
//   camera_matrix | cameraMatrix | Camera_Matrix                     3x3, [fx skew cx; 0 fy cy; 0 0
//   1] distortion_coefficients | dist_coeffs | distCoeffs | Distortion_Coefficients
//                                               4, 5, 8, 12 or 14, as a row or a column
//   image_width, image_height | image_Width, image_Height | cameraResolution    optional
//   cameraMatrix_std_dev | camera_matrix_std_dev, dist_coeffs_std_dev |
//   distortion_coefficients_std_dev             optional: a covariance without correlations
//
//   fisheye_model, not 0                        the four coefficients are cv::fisheye's
//   xi                                          cv::omnidir's, a number or a 1x1 matrix
//
// Of perspective cameras OpenCV's functions leave the skew out, so that none is written.
//
// Pixel (0, 0) is the centre of the top-left pixel there too. Four coefficients without one of
// these two keys, which OpenCV's sample programs write, are k1 k2 p1 p2.
#pragma once

#include <filesystem>

#include "calib/camera/camera_model.h"

namespace etalon {

// Width and height are 0 where the file gives none. Throws ConfigError.
CameraModel read_opencv_camera(const std::filesystem::path& path);

// OpenCV YAML, or XML or JSON for a path that ends so, with the shortest list of coefficients that
// holds all that are not 0 or have a standard deviation (at least 5); numbers read back as the same
// doubles. Of a covariance the standard deviations are written as cameraMatrix_std_dev and
// dist_coeffs_std_dev (0: not known), whose squares read back within rounding; correlations,
// serial, lens and sensor have no place in it.
void write_opencv_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
