// Formats of other tools and what they share. Principal points: the tool's (first_pixel_centre()).
#pragma once

#include <functional>

#include "calib/camera/camera_model.h"
#include "core/config/strict_reader.h"

namespace etalon {

// The formats: at the top of each tool's file. `select` as of read_foreign_camera().
CameraModel read_opencv_camera(const std::filesystem::path& path);
CameraModel read_ros_camera(const std::filesystem::path& path);
CameraModel read_kalibr_camera(const std::filesystem::path& path, const std::string& select);
CameraModel read_mrcal_camera(const std::filesystem::path& path);
CameraModel read_matlab_camera(const std::filesystem::path& path);
CameraModel read_boofcv_camera(const std::filesystem::path& path);
CameraModel read_colmap_camera(const std::filesystem::path& path, const std::string& select);

void write_opencv_camera(const std::filesystem::path& path, const CameraModel& camera);
void write_ros_camera(const std::filesystem::path& path, const CameraModel& camera);
void write_kalibr_camera(const std::filesystem::path& path, const CameraModel& camera);
void write_mrcal_camera(const std::filesystem::path& path, const CameraModel& camera);
void write_matlab_camera(const std::filesystem::path& path, const CameraModel& camera);
void write_boofcv_camera(const std::filesystem::path& path, const CameraModel& camera);
void write_colmap_camera(const std::filesystem::path& path, const CameraModel& camera);

// The mapping that a YAML or JSON text must be. Throws ConfigError otherwise.
Value foreign_root(const std::string& text, const std::string& file);

// A matrix of a file, row by row, with its place there.
struct ForeignMatrix {
    SourcePlace place;
    int rows = 0, cols = 0;
    std::vector<double> values;
};

// Throws ConfigError at a matrix that says another size than it has numbers.
void set_size(ForeignMatrix& matrix, double rows, double cols);

// Of a 3x3 matrix [fx skew cx; 0 fy cy; 0 0 1]. Throws ConfigError at one that is something else.
Intrinsics intrinsics_of(const ForeignMatrix& matrix);

// fx and fy positive, all finite. Throws ConfigError at `place` otherwise.
Intrinsics checked_intrinsics(double fx, double fy, double cx, double cy, const SourcePlace& place,
                              double skew = 0.0);

// A whole number of pixels, 1 to 100 000, and a list of two. Throw ConfigError otherwise.
int checked_image_side(double value, const SourcePlace& place);
int image_side(const Value& value);
std::pair<int, int> image_sides(const Value& value);

// Distortion coefficients by our names, or omega (field of view); numbers missing at the end are 0.
using ParameterNames = std::vector<std::string_view>;
void set_parameters(CameraModel& camera, const ParameterNames& names,
                    const std::vector<double>& numbers);
std::vector<double> parameters_of(const CameraModel& camera, const ParameterNames& names);

// The first of our names, which have OpenCV's order up to 14.
ParameterNames first_coefficients(std::size_t count);

// Kannala and Brandt's coefficients of theta^3, ^5, ^7 and ^9, over the equidistant projection.
inline const ParameterNames kannala_brandt{"k1", "k2", "k3", "k7"};

// A model of a tool: its name there, and its parameters in the tool's order.
struct ForeignModel {
    const char* name;
    Projection projection;
    ParameterNames parameters;
    bool one_focal_length = false;
};
using ForeignModels = std::vector<ForeignModel>;

// Throws ConfigError at `place`, listing the names, when no model has this one.
const ForeignModel& model_named(const ForeignModels& models, const std::string& name,
                                const SourcePlace& place);

// The first model of the camera's projection with two focal lengths that holds all coefficients but
// 0. Throws ConfigError at `path`, naming the first that `format` has no place for.
const ForeignModel& model_holding(const ForeignModels& models, const CameraModel& camera,
                                  const std::filesystem::path& path, const char* format);
// The same for a format with one model.
void require_only(const CameraModel& camera, const ParameterNames& names,
                  const std::filesystem::path& path, const char* format);

// What every writer of a foreign format requires: a projection that it has, an image size, finite
// numbers. Throws ConfigError at `path`.
void require_projection(const CameraModel& camera, const std::filesystem::path& path,
                        const char* format, std::initializer_list<Projection> projections);
void require_foreign_camera(const CameraModel& camera, const std::filesystem::path& path,
                            const char* format, std::initializer_list<Projection> projections);

// For formats that have no skew. Throws ConfigError at `path` where it is not 0.
void require_no_skew(const CameraModel& camera, const std::filesystem::path& path,
                     const char* format);

// A projection with a file's parameters. Throws ConfigError at `place` for make()'s NumericalError.
LensProjection projection_at(const SourcePlace& place, const std::function<LensProjection()>& make);
LensProjection checked_projection(const LensProjection& projection, const SourcePlace& place);

// A number that reads back as the same double, with a decimal point: YAML 1.1, of PyYAML and
// SnakeYAML, takes 5 for an integer and 1e-05 for text. And several, with ", " between them.
std::string yaml_real(double value);
std::string yaml_reals(const std::vector<double>& values);

}  // namespace etalon
