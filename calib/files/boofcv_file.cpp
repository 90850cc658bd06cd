#include "calib/files/foreign_camera.h"

#include <fmt/format.h>

#include "calib/files/foreign_value.h"
#include "core/file/text.h"

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

bool is_all_zero(const ForeignValue& list) {
    const std::vector<double> values = list.numbers();
    return std::all_of(values.begin(), values.end(), [](double value) { return value == 0.0; });
}

// BoofCV's asymmetric terms are a polynomial of the angle times a polynomial of the azimuth's sines
// and cosines: nothing when one of the two is zero.
void refuse_asymmetric_terms(const ForeignValue& root) {
    for (const char* name : {"radial", "tangent"}) {
        const auto of_angle = root.find(name), of_azimuth = root.find(std::string(name) + "_trig");
        if (of_angle && of_azimuth && !is_all_zero(*of_angle) && !is_all_zero(*of_azimuth))
            of_angle->fail("is an asymmetric term of Kannala and Brandt, which no model here has");
    }
}

// The first coefficient, of theta itself, goes into the focal lengths: here it is 1.
void read_kannala_brandt(const ForeignValue& root, CameraModel& camera) {
    const ForeignValue symmetric = root.at("symmetric");
    const std::vector<double> k = symmetric.numbers();
    if (k.empty() || k.size() > 5)
        symmetric.fail(fmt::format("must have 1 to 5 coefficients, not {}", k.size()));
    if (!(k[0] > 0.0))
        symmetric.fail(fmt::format("must begin with a positive coefficient, not {}", k[0]));
    refuse_asymmetric_terms(root);
    camera.projection.kind = Projection::equidistant;
    Intrinsics& i = camera.intrinsics;
    i = checked_intrinsics(k[0] * i.fx, k[0] * i.fy, i.cx, i.cy, symmetric.place(), k[0] * i.skew);
    std::vector<double> relative;
    for (std::size_t n = 1; n < k.size(); ++n)
        relative.push_back(k[n] / k[0]);
    if (std::any_of(relative.begin(), relative.end(), [](double x) { return !std::isfinite(x); }))
        symmetric.fail("has coefficients that are too large beside the first");
    camera.distortion = kannala_brandt(relative);
}

std::string boofcv_lines(const CameraModel& camera) {
    const Distortion& d = camera.distortion;
    if (camera.projection.kind == Projection::equidistant) {
        std::string lines = "symmetric:\n- 1.0\n";
        for (const double k : kannala_brandt_coefficients(d))
            lines += "- " + yaml_real(k) + "\n";
        return lines + "radial: []\nradial_trig: []\ntangent: []\ntangent_trig: []\n";
    }
    const std::string lines = fmt::format(
        "radial_tangential:\n  radial:\n  - {}\n  - {}\n  - {}\n  t1: {}\n  t2: {}\n",
        yaml_real(d.k1), yaml_real(d.k2), yaml_real(d.k3), yaml_real(d.p1), yaml_real(d.p2));
    return camera.projection.kind == Projection::unified
               ? lines + "mirror_offset: " + yaml_real(camera.projection.a) + "\n"
               : lines;
}

}  // namespace

CameraModel read_boofcv_camera(const std::filesystem::path& path) {
    const ForeignValue root = ForeignValue::parse(read_text(path), path.string());
    const ForeignValue model = root.at("model");
    const std::string name = model.text();
    if (name != "pinhole" && name != "pinhole_radial_tangential" &&
        name != "omnidirectional_universal" && name != "kannala_brandt")
        model.fail(
            "must be pinhole, pinhole_radial_tangential, omnidirectional_universal or "
            "kannala_brandt, not '" +
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
    if (name == "kannala_brandt")
        read_kannala_brandt(root, camera);
    else if (name != "pinhole")
        camera.distortion = boofcv_distortion(root.at("radial_tangential"));
    if (name == "omnidirectional_universal") {
        const ForeignValue offset = root.at("mirror_offset");
        camera.projection =
            checked_projection({Projection::unified, offset.number()}, offset.place());
    }
    return camera;
}

void write_boofcv_camera(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "a BoofCV file";
    const Projection kind = camera.projection.kind;
    require_foreign_camera(camera, path, format,
                           {Projection::perspective, Projection::unified, Projection::equidistant});
    if (kind == Projection::equidistant)
        require_only(camera, {"k1", "k2", "k3", "k7"}, path, format);
    else
        shortest_distortion(camera, {5}, path, format);
    const Intrinsics i = to_pixels_of(CalibrationTool::boofcv, camera.intrinsics);
    const char* model = kind == Projection::equidistant ? "kannala_brandt"
                        : kind == Projection::unified   ? "omnidirectional_universal"
                                                        : "pinhole_radial_tangential";
    write_text(path, fmt::format("# Camera model with radial and tangential distortion\n"
                                 "model: {}\n"
                                 "version: 0\n"
                                 "pinhole:\n"
                                 "  width: {}\n  height: {}\n  fx: {}\n  fy: {}\n  skew: {}\n"
                                 "  cx: {}\n  cy: {}\n{}",
                                 model, camera.width, camera.height, yaml_real(i.fx),
                                 yaml_real(i.fy), yaml_real(i.skew), yaml_real(i.cx),
                                 yaml_real(i.cy), boofcv_lines(camera)));
}

}  // namespace etalon
