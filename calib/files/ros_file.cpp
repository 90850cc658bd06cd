#include "calib/files/foreign_camera.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "calib/files/foreign_value.h"
#include "core/file/text.h"

namespace etalon {
namespace {

ForeignMatrix read_matrix(const ForeignValue& entry) {
    ForeignMatrix matrix{entry.place()};
    const double rows = entry.at("rows").number(), cols = entry.at("cols").number();
    matrix.values = entry.at("data").numbers();
    if (!(rows >= 1 && cols >= 1 && rows * cols == static_cast<double>(matrix.values.size())))
        throw ConfigError(matrix.place, fmt::format("says {}x{} but has {} numbers", rows, cols,
                                                    matrix.values.size()));
    matrix.rows = static_cast<int>(rows);
    matrix.cols = static_cast<int>(cols);
    return matrix;
}

// Of a model that is not `equidistant`, what camera_from_matrices() takes.
void check_model(const ForeignValue& model, const ForeignMatrix& distortion) {
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
    const std::string file = path.string();
    const ForeignValue root = ForeignValue::parse(read_text(path), file);
    const ForeignValue camera_matrix = root.at("camera_matrix");
    const ForeignMatrix distortion = read_matrix(root.at("distortion_coefficients"));
    check_model(root.at("distortion_model"), distortion);
    CameraModel camera = camera_from_matrices(read_matrix(camera_matrix), distortion);
    if (camera.intrinsics.skew != 0.0)
        camera_matrix.fail(
            fmt::format("has a skew of {}, which ROS's K does not have", camera.intrinsics.skew));
    camera.intrinsics = from_pixels_of(CalibrationTool::ros, camera.intrinsics);
    if (root.at("distortion_model").text() == "equidistant") {
        camera.projection.kind = Projection::equidistant;
        camera.distortion = kannala_brandt(distortion.values);
    }
    const ForeignValue width = root.at("image_width"), height = root.at("image_height");
    camera.width = checked_image_side(width.number(), width.place());
    camera.height = checked_image_side(height.number(), height.place());
    return camera;
}

void write_ros_camera(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "ROS camera_info";
    require_foreign_camera(camera, path, format,
                           {Projection::perspective, Projection::equidistant});
    require_no_skew(camera, path, format);
    const Intrinsics i = to_pixels_of(CalibrationTool::ros, camera.intrinsics);
    std::vector<std::string> listed;
    if (camera.projection.kind == Projection::equidistant) {
        require_only(camera, {"k1", "k2", "k3", "k7"}, path, format);
        for (const double k : kannala_brandt_coefficients(camera.distortion))
            listed.push_back(yaml_real(k));
    } else {
        const int count = shortest_distortion(camera, {5, 8}, path, format);
        const auto coefficients = camera.distortion.in_opencv_order();
        for (int k = 0; k < count; ++k)
            listed.push_back(yaml_real(coefficients[static_cast<std::size_t>(k)]));
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
                           listed.size(), fmt::join(listed, ", "), fx, cx, fy, cy));
}

}  // namespace etalon
