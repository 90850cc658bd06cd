#include "calib/files/foreign_camera.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "calib/camera/camera_model.h"
#include "core/config/strict_reader.h"
#include "core/file/text.h"

namespace etalon {
namespace {

void check_finite(const ForeignMatrix& matrix) {
    for (const double value : matrix.values)
        if (!std::isfinite(value))
            throw ConfigError(matrix.place, "has a number that is not finite");
}

Intrinsics intrinsics_of(const ForeignMatrix& matrix) {
    if (matrix.rows != 3 || matrix.cols != 3 || matrix.values.size() != 9)
        throw ConfigError(matrix.place,
                          fmt::format("must be a 3x3 matrix, not {}x{} with {} numbers",
                                      matrix.rows, matrix.cols, matrix.values.size()));
    check_finite(matrix);
    const std::vector<double>& m = matrix.values;
    if (m[3] != 0.0 || m[6] != 0.0 || m[7] != 0.0 || m[8] != 1.0)
        throw ConfigError(matrix.place, "must be [fx skew cx; 0 fy cy; 0 0 1]");
    return checked_intrinsics(m[0], m[4], m[2], m[5], matrix.place, m[1]);
}

Distortion distortion_of(const ForeignMatrix& matrix) {
    const std::size_t count = matrix.values.size();
    const bool is_vector = matrix.rows == 1 || matrix.cols == 1;
    const bool known = count == 4 || count == 5 || count == 8 || count == 12 || count == 14;
    if (!is_vector || !known)
        throw ConfigError(matrix.place,
                          fmt::format("must be a row or column of 4, 5, 8, 12 or 14 coefficients, "
                                      "not {}x{} with {} numbers",
                                      matrix.rows, matrix.cols, count));
    check_finite(matrix);
    std::array<double, 14> all{};
    std::copy(matrix.values.begin(), matrix.values.end(), all.begin());
    return Distortion::from_opencv_order(all);
}

// The first coefficient that is not 0 and not named.
std::optional<std::size_t> first_besides(const Distortion& distortion,
                                         const std::vector<std::string_view>& names) {
    const auto coefficients = distortion.coefficients();
    for (std::size_t i = 0; i < coefficients.size(); ++i)
        if (coefficients[i] != 0.0 &&
            std::find(names.begin(), names.end(), distortion_names[i]) == names.end())
            return i;
    return std::nullopt;
}

}  // namespace

CameraModel camera_from_matrices(const ForeignMatrix& camera_matrix,
                                 const ForeignMatrix& distortion) {
    CameraModel camera;
    camera.intrinsics = intrinsics_of(camera_matrix);
    camera.distortion = distortion_of(distortion);
    return camera;
}

Intrinsics checked_intrinsics(double fx, double fy, double cx, double cy, const SourcePlace& place,
                              double skew) {
    for (const double value : {fx, fy, cx, cy, skew})
        if (!std::isfinite(value))
            throw ConfigError(place, "has a number that is not finite");
    if (fx <= 0.0 || fy <= 0.0)
        throw ConfigError(place, fmt::format("fx and fy must be positive, not {} and {}", fx, fy));
    for (const double focal_length : {fx, fy})
        if (const Range range = units::px.positive(); !range.contains(focal_length))
            throw ConfigError(place, fmt::format("{} must be {}", focal_length, range.words()));
    for (const double length : {cx, cy, skew})
        if (const Range range = units::px.either_sign(); !range.contains(length))
            throw ConfigError(place, fmt::format("{} must be {}", length, range.words()));
    return {.fx = fx, .fy = fy, .cx = cx, .cy = cy, .skew = skew};
}

int shortest_distortion(const CameraModel& camera, std::initializer_list<int> counts,
                        const std::filesystem::path& path, const char* format) {
    const auto coefficients = camera.distortion.coefficients();
    std::size_t needed = coefficients.size();
    while (needed > 0 && coefficients[needed - 1] == 0.0)
        --needed;
    for (const int count : counts)
        if (static_cast<std::size_t>(count) >= needed)
            return count;
    for (std::size_t i = static_cast<std::size_t>(*(counts.end() - 1)); i < needed; ++i)
        if (coefficients[i] != 0.0)
            throw ConfigError({path.string()}, fmt::format("{} has no place for {} = {}", format,
                                                           distortion_names[i], coefficients[i]));
    return 0;
}

bool holds_only(const Distortion& distortion, const std::vector<std::string_view>& names) {
    return !first_besides(distortion, names);
}

void require_only(const CameraModel& camera, const std::vector<std::string_view>& names,
                  const std::filesystem::path& path, const char* format) {
    if (const auto i = first_besides(camera.distortion, names))
        throw ConfigError({path.string()},
                          fmt::format("{} has no place for {} = {}", format, distortion_names[*i],
                                      camera.distortion.coefficients()[*i]));
}

void require_projection(const CameraModel& camera, const std::filesystem::path& path,
                        const char* format, std::initializer_list<Projection> projections) {
    const Projection kind = camera.projection.kind;
    if (std::find(projections.begin(), projections.end(), kind) == projections.end())
        throw ConfigError({path.string()},
                          fmt::format("{} has no {} cameras", format, name_of(kind).name));
    checked_projection(camera.projection, {path.string()});
}

void require_foreign_camera(const CameraModel& camera, const std::filesystem::path& path,
                            const char* format, std::initializer_list<Projection> projections) {
    require_projection(camera, path, format, projections);
    if (camera.width < 1 || camera.height < 1)
        throw ConfigError({path.string()}, "the image size is not known");
    const Intrinsics& i = camera.intrinsics;
    checked_intrinsics(i.fx, i.fy, i.cx, i.cy, {path.string()}, i.skew);
    for (const double coefficient : camera.distortion.coefficients())
        if (!std::isfinite(coefficient))
            throw ConfigError({path.string()}, "has a coefficient that is not finite");
}

void require_no_skew(const CameraModel& camera, const std::filesystem::path& path,
                     const char* format) {
    if (camera.intrinsics.skew != 0.0)
        throw ConfigError({path.string()}, fmt::format("{} has no place for skew = {}", format,
                                                       camera.intrinsics.skew));
}

Distortion kannala_brandt(const std::vector<double>& coefficients) {
    std::array<double, 4> k{};
    std::copy_n(coefficients.begin(), std::min(coefficients.size(), k.size()), k.begin());
    return {.k1 = k[0], .k2 = k[1], .k3 = k[2], .k7 = k[3]};
}

std::array<double, 4> kannala_brandt_coefficients(const Distortion& d) {
    return {d.k1, d.k2, d.k3, d.k7};
}

LensProjection projection_at(const SourcePlace& place,
                             const std::function<LensProjection()>& make) {
    try {
        return make();
    } catch (const NumericalError& error) {
        throw ConfigError(place, error.what());
    }
}

LensProjection checked_projection(const LensProjection& projection, const SourcePlace& place) {
    return projection_at(place, [&] {
        require_possible(projection);
        return projection;
    });
}

std::string yaml_real(double value) {
    std::string text = exact(value);
    if (text.find('.') == std::string::npos)
        text.insert(std::min(text.find('e'), text.size()), ".0");
    return text;
}

int checked_image_side(double value, const SourcePlace& place) {
    if (!(value >= 1.0 && value <= 100'000.0) || value != std::floor(value))
        throw ConfigError(
            place, fmt::format("must be a whole number of 1 to 100000 pixels, not {}", value));
    return static_cast<int>(value);
}

// Sources:
//   OpenCV, ROS    pixel centres at integers; camera_calibration of ROS calls cv::calibrateCamera
//   Kalibr         its chessboards and tags end in cv::cornerSubPix, whose pixel centres are at
//                  integers (Kalibr's issue 115 tries both detectors on drawn images)
//   mrcal          "No changes to the content are made" from and to ROS' and Kalibr's models
//                  (mrcal-from-ros(1), mrcal-to-kalibr(1))
//   MATLAB         "specifies the pixel center at (1,1)" (documentation of
//                  cameraIntrinsicsToOpenCV, which subtracts 1 from the principal point)
//   BoofCV         its simulator takes a pixel's value from model coordinates x to x + 1
//                  (SimulatePlanarWorld.computeProjectionTable), and its chessboard detector adds
//                  0.5 to what it finds in samples at integers (DetectChessboardCornersX.process);
//                  no document says so
//   COLMAP         "the center of the upper left most pixel has coordinate (0.5, 0.5)"
//                  (its tutorial on features)
double first_pixel_centre(CalibrationTool tool) {
    switch (tool) {
        case CalibrationTool::opencv:
        case CalibrationTool::ros:
        case CalibrationTool::kalibr:
        case CalibrationTool::mrcal:
            break;
        case CalibrationTool::matlab:
            return 1.0;
        case CalibrationTool::boofcv:
        case CalibrationTool::colmap:
            return 0.5;
    }
    return 0.0;
}

Intrinsics from_pixels_of(CalibrationTool tool, Intrinsics intrinsics) {
    const double shift = first_pixel_centre(tool);
    intrinsics.cx -= shift;
    intrinsics.cy -= shift;
    return intrinsics;
}

Intrinsics to_pixels_of(CalibrationTool tool, Intrinsics intrinsics) {
    const double shift = first_pixel_centre(tool);
    intrinsics.cx += shift;
    intrinsics.cy += shift;
    return intrinsics;
}

}  // namespace etalon
