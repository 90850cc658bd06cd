#include "calib/files/kalibr_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "calib/files/foreign_camera.h"
#include "calib/files/foreign_value.h"
#include "calib/files/pixel_origin.h"
#include "core/text.h"

namespace etalon {
namespace {

ForeignValue choose_camera(const ForeignValue& root, const std::string& name) {
    if (!name.empty())
        return root.at(name);
    std::vector<std::string> cameras;
    for (const std::string& key : root.keys())
        if (key.starts_with("cam"))
            cameras.push_back(key);
    if (cameras.empty())
        root.fail("has no camera cam0");
    if (cameras.size() > 1)
        root.fail(fmt::format("has {} cameras ({}): name one, by `etalon camera convert --select`",
                              cameras.size(), fmt::join(cameras, ", ")));
    return root.at(cameras.front());
}

Distortion kalibr_distortion(const ForeignValue& camera) {
    const ForeignValue model = camera.at("distortion_model");
    const std::string name = model.text();
    if (name == "none")
        return {};
    if (name != "radtan")
        model.fail("must be radtan or none, not '" + name + "'");
    const auto c = camera.at("distortion_coeffs").numbers(4);
    return {.k1 = c[0], .k2 = c[1], .p1 = c[2], .p2 = c[3]};
}

}  // namespace

CameraModel read_kalibr_camera(const std::filesystem::path& path, const std::string& name) {
    const ForeignValue chosen =
        choose_camera(ForeignValue::parse(read_text(path), path.string()), name);
    const ForeignValue model = chosen.at("camera_model");
    if (model.text() != "pinhole")
        model.fail("must be pinhole, not '" + model.text() + "'");
    const ForeignValue intrinsics = chosen.at("intrinsics"), size = chosen.at("resolution");
    const auto i = intrinsics.numbers(4), sides = size.numbers(2);
    CameraModel camera;
    camera.intrinsics = from_pixels_of(
        CalibrationTool::kalibr, checked_intrinsics(i[0], i[1], i[2], i[3], intrinsics.place()));
    camera.distortion = kalibr_distortion(chosen);
    camera.width = checked_image_side(sides[0], size.place());
    camera.height = checked_image_side(sides[1], size.place());
    return camera;
}

void write_kalibr_camera(const std::filesystem::path& path, const CameraModel& camera) {
    require_foreign_camera(camera, path, "a Kalibr camchain");
    shortest_distortion(camera, {4}, path, "a Kalibr camchain");
    const Intrinsics i = to_pixels_of(CalibrationTool::kalibr, camera.intrinsics);
    const Distortion& d = camera.distortion;
    write_text(path, fmt::format("cam0:\n"
                                 "  camera_model: pinhole\n"
                                 "  intrinsics: [{}, {}, {}, {}]\n"
                                 "  distortion_model: radtan\n"
                                 "  distortion_coeffs: [{}, {}, {}, {}]\n"
                                 "  resolution: [{}, {}]\n"
                                 "  rostopic: /cam0/image_raw\n",
                                 yaml_real(i.fx), yaml_real(i.fy), yaml_real(i.cx), yaml_real(i.cy),
                                 yaml_real(d.k1), yaml_real(d.k2), yaml_real(d.p1), yaml_real(d.p2),
                                 camera.width, camera.height));
}

}  // namespace etalon
