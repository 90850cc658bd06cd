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
    if (name != "pinhole" && name != "pinhole_radial_tangential" &&
        name != "omnidirectional_universal")
        model.fail(
            "must be pinhole, pinhole_radial_tangential or omnidirectional_universal, not '" +
            name + "'");
    const ForeignValue pinhole = root.at("pinhole");
    const auto number = [&](const char* key) { return pinhole.at(key).number(); };
    const auto skew = pinhole.find("skew");
    CameraModel camera;
    camera.width = checked_image_side(number("width"), pinhole.at("width").place());
    camera.height = checked_image_side(number("height"), pinhole.at("height").place());
    camera.intrinsics =
        from_pixels_of(CalibrationTool::boofcv,
                       checked_intrinsics(number("fx"), number("fy"), number("cx"), number("cy"),
                                          pinhole.place(), skew ? skew->number() : 0.0));
    if (name != "pinhole")
        camera.distortion = boofcv_distortion(root.at("radial_tangential"));
    if (name == "omnidirectional_universal") {
        const ForeignValue offset = root.at("mirror_offset");
        camera.projection =
            checked_projection({Projection::unified, offset.number()}, offset.place());
    }
    return camera;
}

void write_boofcv_camera(const std::filesystem::path& path, const CameraModel& camera) {
    require_foreign_camera(camera, path, "a BoofCV file",
                           {Projection::perspective, Projection::unified});
    shortest_distortion(camera, {5}, path, "a BoofCV file");
    const bool is_unified = camera.projection.kind == Projection::unified;
    const Intrinsics i = to_pixels_of(CalibrationTool::boofcv, camera.intrinsics);
    const Distortion& d = camera.distortion;
    const std::string offset =
        is_unified ? "mirror_offset: " + yaml_real(camera.projection.a) + "\n" : "";
    write_text(
        path,
        fmt::format("# Camera model with radial and tangential distortion\n"
                    "model: {}\n"
                    "version: 0\n"
                    "pinhole:\n"
                    "  width: {}\n  height: {}\n  fx: {}\n  fy: {}\n  skew: {}\n"
                    "  cx: {}\n  cy: {}\n"
                    "radial_tangential:\n"
                    "  radial:\n  - {}\n  - {}\n  - {}\n  t1: {}\n  t2: {}\n{}",
                    is_unified ? "omnidirectional_universal" : "pinhole_radial_tangential",
                    camera.width, camera.height, yaml_real(i.fx), yaml_real(i.fy),
                    yaml_real(i.skew), yaml_real(i.cx), yaml_real(i.cy), yaml_real(d.k1),
                    yaml_real(d.k2), yaml_real(d.k3), yaml_real(d.p1), yaml_real(d.p2), offset));
}

}  // namespace etalon
