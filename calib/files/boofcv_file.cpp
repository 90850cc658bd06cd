#include "calib/files/boofcv_file.h"

#include <fmt/format.h>

#include "calib/files/foreign_camera.h"
#include "calib/files/foreign_value.h"
#include "calib/files/pixel_origin.h"
#include "core/text.h"

namespace etalon {
namespace {

Distortion boofcv_distortion(const ForeignValue& value) {
    Distortion distortion;
    if (const auto radial = value.find("radial")) {
        const std::vector<double> k = radial->numbers();
        if (k.size() > 3)
            radial->fail(fmt::format("must have at most 3 coefficients, not {}", k.size()));
        distortion.k1 = k.size() > 0 ? k[0] : 0.0;
        distortion.k2 = k.size() > 1 ? k[1] : 0.0;
        distortion.k3 = k.size() > 2 ? k[2] : 0.0;
    }
    if (const auto t1 = value.find("t1"))
        distortion.p1 = t1->number();
    if (const auto t2 = value.find("t2"))
        distortion.p2 = t2->number();
    return distortion;
}

}  // namespace

CameraModel read_boofcv_camera(const std::filesystem::path& path) {
    const ForeignValue root = ForeignValue::parse(read_text(path), path.string());
    const ForeignValue model = root.at("model");
    const std::string name = model.text();
    if (name != "pinhole" && name != "pinhole_radial_tangential")
        model.fail("must be pinhole or pinhole_radial_tangential, not '" + name + "'");
    const ForeignValue pinhole = root.at("pinhole");
    const auto number = [&](const char* key) { return pinhole.at(key).number(); };
    if (const auto skew = pinhole.find("skew"); skew && skew->number() != 0.0)
        skew->fail(fmt::format("must be 0, not {}: no model here has a skew", skew->number()));
    CameraModel camera;
    camera.width = checked_image_side(number("width"), pinhole.at("width").place());
    camera.height = checked_image_side(number("height"), pinhole.at("height").place());
    camera.intrinsics = from_pixels_of(CalibrationTool::boofcv,
                                       checked_intrinsics(number("fx"), number("fy"), number("cx"),
                                                          number("cy"), pinhole.place()));
    if (name == "pinhole_radial_tangential")
        camera.distortion = boofcv_distortion(root.at("radial_tangential"));
    return camera;
}

void write_boofcv_camera(const std::filesystem::path& path, const CameraModel& camera) {
    require_foreign_camera(camera, path, "a BoofCV file");
    shortest_distortion(camera, {5}, path, "a BoofCV file");
    const Intrinsics i = to_pixels_of(CalibrationTool::boofcv, camera.intrinsics);
    const Distortion& d = camera.distortion;
    write_text(path, fmt::format("# Pinhole camera model with radial and tangential distortion\n"
                                 "model: pinhole_radial_tangential\n"
                                 "version: 0\n"
                                 "pinhole:\n"
                                 "  width: {}\n  height: {}\n  fx: {}\n  fy: {}\n  skew: 0.0\n"
                                 "  cx: {}\n  cy: {}\n"
                                 "radial_tangential:\n"
                                 "  radial:\n  - {}\n  - {}\n  - {}\n  t1: {}\n  t2: {}\n",
                                 camera.width, camera.height, yaml_real(i.fx), yaml_real(i.fy),
                                 yaml_real(i.cx), yaml_real(i.cy), yaml_real(d.k1), yaml_real(d.k2),
                                 yaml_real(d.k3), yaml_real(d.p1), yaml_real(d.p2)));
}

}  // namespace etalon
