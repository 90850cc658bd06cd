// What the calibration files of other programs have in common: a camera matrix and a list of
// distortion coefficients, checked here once for all formats.
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "calib/camera/camera_model.h"
#include "core/program/errors.h"

namespace etalon {

// A matrix of a file, row by row, with its place there.
struct ForeignMatrix {
    SourcePlace place;
    int rows = 0, cols = 0;
    std::vector<double> values;
};

// The camera of a 3x3 matrix [fx skew cx; 0 fy cy; 0 0 1] and of 4, 5, 8, 12 or 14 coefficients in
// OpenCV's order, as a row or a column. The image size is left 0.
// Throws ConfigError at the matrix that is something else.
CameraModel camera_from_matrices(const ForeignMatrix& camera_matrix,
                                 const ForeignMatrix& distortion);

// A whole number of pixels, 1 to 100 000. Throws ConfigError at `place` otherwise.
int checked_image_side(double value, const SourcePlace& place);

// The same of four numbers: fx and fy positive, all finite, at `place`.
Intrinsics checked_intrinsics(double fx, double fy, double cx, double cy, const SourcePlace& place,
                              double skew = 0.0);

// For writers. The number of coefficients, one of `counts` (ascending, in OpenCV's order), that
// holds all which are not 0. Throws ConfigError at `path`, naming the first coefficient that
// `format` has no place for.
int shortest_distortion(const CameraModel& camera, std::initializer_list<int> counts,
                        const std::filesystem::path& path, const char* format);

// The same for a format that names its coefficients: those not in `names` must be 0. And whether
// they are.
bool holds_only(const Distortion& distortion, const std::vector<std::string_view>& names);
void require_only(const CameraModel& camera, const std::vector<std::string_view>& names,
                  const std::filesystem::path& path, const char* format);

// What every writer of a foreign format requires: a projection that it has, an image size, finite
// numbers. Throws ConfigError at `path`.
void require_projection(const CameraModel& camera, const std::filesystem::path& path,
                        const char* format, std::initializer_list<Projection> projections);
void require_foreign_camera(const CameraModel& camera, const std::filesystem::path& path,
                            const char* format,
                            std::initializer_list<Projection> projections = {
                                Projection::perspective});

// For formats that have no skew. Throws ConfigError at `path` where it is not 0.
void require_no_skew(const CameraModel& camera, const std::filesystem::path& path,
                     const char* format);

// Kannala and Brandt's coefficients of theta^3, ^5, ^7 and ^9, over the equidistant projection: k1,
// k2, k3 and k7 here. Up to four, missing ones are 0.
Distortion kannala_brandt(const std::vector<double>& coefficients);
std::array<double, 4> kannala_brandt_coefficients(const Distortion& distortion);

// A projection with the parameters of a file. Throws ConfigError at `place` where none has them,
// which `make` says by a NumericalError.
LensProjection projection_at(const SourcePlace& place, const std::function<LensProjection()>& make);
LensProjection checked_projection(const LensProjection& projection, const SourcePlace& place);

// A number that reads back as the same double, with a decimal point: YAML 1.1, of PyYAML and
// SnakeYAML, takes 5 for an integer and 1e-05 for text.
std::string yaml_real(double value);

// Calibrations as BoofCV writes them (YAML of its CalibrationIO): model, pinhole {width, height,
// fx, fy, skew, cx, cy} and radial_tangential {radial: [...], t1, t2}.
//
// Read and written are pinhole and pinhole_radial_tangential, whose radial, t1 and t2 are k1 k2 k3,
// p1 and p2 of OpenCV, omnidirectional_universal with the same, and kannala_brandt without its
// asymmetric terms: symmetric has the coefficients of theta, theta^3 to theta^9. Asymmetric terms
// (radial with radial_trig, tangent with tangent_trig) and stereo files are refused by name.

// Throws ConfigError with file, line and key.
CameraModel read_boofcv_camera(const std::filesystem::path& path);

// Throws ConfigError for coefficients beyond k1 k2 p1 p2 k3, of an equidistant camera k1 k2 k3 k7.
void write_boofcv_camera(const std::filesystem::path& path, const CameraModel& camera);

// Calibrations as COLMAP keeps them (cameras.txt): a line `CAMERA_ID MODEL WIDTH HEIGHT PARAMS...`
// for every camera, lines that begin with # apart. Layout: COLMAP's "Output Format" and "Camera
// Models"; orders of parameters: its sensor/models.h.
//
// Read are SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV, FOV,
// SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE and THIN_PRISM_FISHEYE.

// `id`: which camera ("3"); empty: the only one. Throws ConfigError with file, line and field.
CameraModel read_colmap_camera(const std::filesystem::path& path, const std::string& id = "");

// One camera with the id 1, as the first model with two focal lengths that holds it. Throws
// ConfigError for coefficients that COLMAP does not have there, and for a skew.
void write_colmap_camera(const std::filesystem::path& path, const CameraModel& camera);

// Calibrations as Kalibr writes them (camchain.yaml): for every camera cam0, cam1, ... its
// camera_model, intrinsics [fu, fv, pu, pv], distortion_model, distortion_coeffs and resolution
// [width, height]. Layout: the wiki of Kalibr, "yaml formats".
//
// Read and written are camera_model pinhole with the distortion radtan (k1 k2 p1 p2, OpenCV's
// order), equidistant, fov or none, omni with radtan or none, eucm and ds. Poses between cameras
// and the IMU are not read.

// `name`: which camera ("cam1"); empty: the only one. Throws ConfigError with file, line and key.
CameraModel read_kalibr_camera(const std::filesystem::path& path, const std::string& name = "");

// One camera, cam0. Throws ConfigError for coefficients beyond k1 k2 p1 p2 (equidistant k1 k2 k3
// k7), and for a skew.
void write_kalibr_camera(const std::filesystem::path& path, const CameraModel& camera);

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

// Calibrations as mrcal writes them (.cameramodel): a Python dictionary with lensmodel (once
// lens_model), intrinsics [fx, fy, cx, cy, distortion...], imagersize [width, height] and the
// camera's pose. Layout: mrcal's documentation "Camera model representation in memory and on disk"
// and its cameramodel.py.
//
// Read and written are LENSMODEL_PINHOLE and LENSMODEL_OPENCV4, 5, 8 and 12, whose coefficients are
// OpenCV's in OpenCV's order, LENSMODEL_STEREOGRAPHIC, _SPLINED_STEREOGRAPHIC and _CAHVOR, and
// _CAHVORE as far as its entrance pupil stays where it is (its last three numbers are 0). The pose
// and optimization_inputs are not read.

// Throws ConfigError with file, line and key.
CameraModel read_mrcal_camera(const std::filesystem::path& path);

// The first of these models that holds the camera, at the reference frame's origin. Throws
// ConfigError for tau_x and tau_y, a skew, distortion coefficients of other than OpenCV models, and
// a splined field of view that is no whole number of degrees.
void write_mrcal_camera(const std::filesystem::path& path, const CameraModel& camera);

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

// Width and height are 0 where the file gives none. Throws ConfigError.
CameraModel read_opencv_camera(const std::filesystem::path& path);

// OpenCV YAML, or XML or JSON for a path that ends so, with the shortest list of coefficients that
// holds all that are not 0 or have a standard deviation (at least 5); numbers read back as the same
// doubles. Of a covariance the standard deviations are written as cameraMatrix_std_dev and
// dist_coeffs_std_dev (0: not known), whose squares read back within rounding; correlations,
// serial, lens and sensor have no place in it.
void write_opencv_camera(const std::filesystem::path& path, const CameraModel& camera);

// Calibrations as ROS keeps them (camera_info YAML, as written by camera_calibration): image_width,
// image_height, camera_matrix, distortion_model and distortion_coefficients. Models: plumb_bob (5
// coefficients) and rational_polynomial (8), whose order is OpenCV's, and equidistant (4); others
// are refused by name, and so is a skew.
// Rectification and projection matrices describe a rectified image and are not read.
//
// Pixel (0, 0) is the centre of the top-left pixel there too.

// Throws ConfigError with file, line and key.
CameraModel read_ros_camera(const std::filesystem::path& path);

// plumb_bob if it holds the coefficients, else rational_polynomial; no rectification, and the
// camera matrix as the projection. Throws ConfigError for s1..s4, tau_x and tau_y.
void write_ros_camera(const std::filesystem::path& path, const CameraModel& camera);

// Where the calibration tools put the origin of their pixel coordinates. Here pixel (0, 0) is the
// centre of the top-left pixel (docs/conventions.md); every principal point that is read or written
// for another tool goes through these functions, and through nothing else.

enum class CalibrationTool { opencv, ros, kalibr, mrcal, matlab, boofcv, colmap };

// What the tool calls the centre of the top-left pixel, the same along x and y: 0, 0.5 or 1 px.
double first_pixel_centre(CalibrationTool tool);

// The principal point moved from the tool's pixels to ours, and back. Within a rounding error of
// the principal point (1e-13 px of some hundreds) where the origins differ, exact otherwise.
Intrinsics from_pixels_of(CalibrationTool tool, Intrinsics intrinsics);
Intrinsics to_pixels_of(CalibrationTool tool, Intrinsics intrinsics);

}  // namespace etalon
