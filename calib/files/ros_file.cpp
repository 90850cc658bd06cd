// Calibrations as ROS keeps them (camera_info YAML of camera_calibration): image_width,
// image_height, camera_matrix, distortion_model and distortion_coefficients. Models: plumb_bob (5)
// and rational_polynomial (8), in OpenCV's order, and equidistant (4); others and a skew are
// refused. Rectification and projection matrices are not read.
//
// Written is plumb_bob if it holds the coefficients, else rational_polynomial; no rectification,
// and the camera matrix as the projection. Throws ConfigError for s1..s4, tau_x and tau_y.
#include "calib/files/foreign_file.h"

#include <fmt/format.h>

#include "core/file/text.h"

namespace etalon {
namespace {

ForeignMatrix read_matrix(const Value& entry) {
    ForeignMatrix matrix{entry.place()};
    matrix.values = entry.at("data").numbers(0, any_number);
    set_size(matrix, entry.at("rows").number(any_number), entry.at("cols").number(any_number));
    return matrix;
}

const ForeignModels& ros_models() {
    static const ForeignModels all{
        {"plumb_bob", Projection::perspective, first_coefficients(5)},
        {"rational_polynomial", Projection::perspective, first_coefficients(8)},
        {"equidistant", Projection::equidistant, kannala_brandt}};
    return all;
}

}  // namespace

CameraModel read_ros_camera(const std::filesystem::path& path) {
    const Value root = foreign_root(read_text(path), path.string());
    const Value camera_matrix = root.at("camera_matrix");
    const Value name = root.at("distortion_model");
    const ForeignModel& model = model_named(ros_models(), name.text(), name.place());
    const ForeignMatrix distortion = read_matrix(root.at("distortion_coefficients"));
    if (distortion.values.size() != model.parameters.size())
        throw ConfigError(distortion.place,
                          fmt::format("{} has {} coefficients, not {}", model.name,
                                      model.parameters.size(), distortion.values.size()));
    CameraModel camera;
    camera.intrinsics = intrinsics_of(read_matrix(camera_matrix));
    camera.projection.kind = model.projection;
    set_parameters(camera, model.parameters, distortion.values);
    if (camera.intrinsics.skew != 0.0)
        camera_matrix.fail(
            fmt::format("has a skew of {}, which ROS's K does not have", camera.intrinsics.skew));
    camera.width = image_side(root.at("image_width"));
    camera.height = image_side(root.at("image_height"));
    return camera;
}

void write_ros_camera(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "ROS camera_info";
    require_foreign_camera(camera, path, format,
                           {Projection::perspective, Projection::equidistant});
    require_no_skew(camera, path, format);
    const Intrinsics& i = camera.intrinsics;
    const ForeignModel& model = model_holding(ros_models(), camera, path, format);
    const std::string fx = yaml_real(i.fx), fy = yaml_real(i.fy), cx = yaml_real(i.cx),
                      cy = yaml_real(i.cy);
    write_text(path,
               fmt::format("image_width: {}\nimage_height: {}\ncamera_name: camera\n"
                           "camera_matrix:\n  rows: 3\n  cols: 3\n"
                           "  data: [{}, 0.0, {}, 0.0, {}, {}, 0.0, 0.0, 1.0]\n"
                           "distortion_model: {}\n"
                           "distortion_coefficients:\n  rows: 1\n  cols: {}\n  data: [{}]\n"
                           "rectification_matrix:\n  rows: 3\n  cols: 3\n"
                           "  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
                           "projection_matrix:\n  rows: 3\n  cols: 4\n"
                           "  data: [{}, 0.0, {}, 0.0, 0.0, {}, {}, 0.0, 0.0, 0.0, 1.0, 0.0]\n",
                           camera.width, camera.height, fx, cx, fy, cy, model.name,
                           model.parameters.size(),
                           yaml_reals(parameters_of(camera, model.parameters)), fx, cx, fy, cy));
}

}  // namespace etalon
