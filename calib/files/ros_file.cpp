// Calibrations as ROS keeps them (camera_info YAML, as written by camera_calibration): image_width,
// image_height, camera_matrix, distortion_model and distortion_coefficients. Models: plumb_bob (5
// coefficients) and rational_polynomial (8), whose order is OpenCV's, and equidistant (4); others
// are refused by name, and so is a skew.
// Rectification and projection matrices describe a rectified image and are not read.
//
// Pixel (0, 0) is the centre of the top-left pixel there too.
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

// Of a model that is not `equidistant`, what camera_from_matrices() takes.
void check_model(const Value& model, const ForeignMatrix& distortion) {
    const std::string name = model.text();
    if (name != "plumb_bob" && name != "rational_polynomial" && name != "equidistant")
        throw ConfigError(
            model.place(),
            "must be plumb_bob, rational_polynomial or equidistant, not '" + name + "'");
    const std::size_t count = name == "plumb_bob" ? 5 : name == "equidistant" ? 4 : 8;
    if (distortion.values.size() != count)
        throw ConfigError(distortion.place, fmt::format("{} has {} coefficients, not {}", name,
                                                        count, distortion.values.size()));
}

}  // namespace

CameraModel read_ros_camera(const std::filesystem::path& path) {
    const Value root = foreign_root(read_text(path), path.string());
    const Value camera_matrix = root.at("camera_matrix");
    const ForeignMatrix distortion = read_matrix(root.at("distortion_coefficients"));
    check_model(root.at("distortion_model"), distortion);
    CameraModel camera = camera_from_matrices(read_matrix(camera_matrix), distortion);
    if (camera.intrinsics.skew != 0.0)
        camera_matrix.fail(
            fmt::format("has a skew of {}, which ROS's K does not have", camera.intrinsics.skew));
    if (root.at("distortion_model").text() == "equidistant") {
        camera.projection.kind = Projection::equidistant;
        camera.distortion = {};
        set_parameters(camera, kannala_brandt, distortion.values);
    }
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
    std::vector<double> listed;
    if (camera.projection.kind == Projection::equidistant) {
        require_only(camera, kannala_brandt, path, format);
        listed = parameters_of(camera, kannala_brandt);
    } else {
        const int count = shortest_distortion(camera, {5, 8}, path, format);
        const auto coefficients = camera.distortion.in_opencv_order();
        listed.assign(coefficients.begin(), coefficients.begin() + count);
    }
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
                           camera.width, camera.height, fx, cx, fy, cy,
                           listed.size() == 4   ? "equidistant"
                           : listed.size() == 5 ? "plumb_bob"
                                                : "rational_polynomial",
                           listed.size(), yaml_reals(listed), fx, cx, fy, cy));
}

}  // namespace etalon
