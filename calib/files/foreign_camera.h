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

}  // namespace etalon
