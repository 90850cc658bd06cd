// Calibrations as BoofCV writes them (YAML of its CalibrationIO): model, pinhole {width, height,
// fx, fy, skew, cx, cy} and radial_tangential {radial: [...], t1, t2}.
//
// Models: pinhole, pinhole_radial_tangential (radial, t1, t2 are OpenCV's k1 k2 k3, p1, p2),
// omnidirectional_universal with the same, kannala_brandt (symmetric: theta, theta^3 to theta^9).
// Asymmetric terms (radial with radial_trig, tangent with tangent_trig) and stereo files are
// refused by name. Not written: coefficients beyond k1 k2 p1 p2 k3, equidistant k1 k2 k3 k7.
#include "calib/files/foreign_file.h"

#include <fmt/format.h>

#include "core/file/text.h"

namespace etalon {
namespace {

void read_radial_tangential(const Value& value, CameraModel& camera) {
    if (const auto radial = value.find("radial")) {
        const std::vector<double> k = radial->numbers(0, any_number);
        if (k.size() > 3)
            radial->fail(fmt::format("must have at most 3 coefficients, not {}", k.size()));
        set_parameters(camera, {"k1", "k2", "k3"}, k);
    }
    camera.distortion.p1 = value.number_or_zero("t1", any_number);
    camera.distortion.p2 = value.number_or_zero("t2", any_number);
}

bool is_all_zero(const Value& list) {
    const std::vector<double> values = list.numbers(0, any_number);
    return std::all_of(values.begin(), values.end(), [](double value) { return value == 0.0; });
}

// A polynomial of the angle times one of the azimuth: nothing when either is zero.
void refuse_asymmetric_terms(const Value& root) {
    for (const char* name : {"radial", "tangent"}) {
        const auto of_angle = root.find(name), of_azimuth = root.find(std::string(name) + "_trig");
        if (of_angle && of_azimuth && !is_all_zero(*of_angle) && !is_all_zero(*of_azimuth))
            of_angle->fail("is an asymmetric term of Kannala and Brandt, which no model here has");
    }
}

// The first coefficient, of theta itself, goes into the focal lengths: here it is 1.
void read_kannala_brandt(const Value& root, CameraModel& camera) {
    const Value symmetric = root.at("symmetric");
    const std::vector<double> k = symmetric.numbers(0, any_number);
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
        symmetric.fail("has coefficients that are too large relative to the first");
    set_parameters(camera, kannala_brandt, relative);
}

std::string boofcv_lines(const CameraModel& camera) {
    const Distortion& d = camera.distortion;
    if (camera.projection.kind == Projection::equidistant) {
        std::string lines = "symmetric:\n- 1.0\n";
        for (const double k : parameters_of(camera, kannala_brandt))
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
    const Value root = foreign_root(read_text(path), path.string());
    const Value model = root.at("model");
    const std::string name = model.text();
    if (name != "pinhole" && name != "pinhole_radial_tangential" &&
        name != "omnidirectional_universal" && name != "kannala_brandt")
        model.fail(
            "must be pinhole, pinhole_radial_tangential, omnidirectional_universal or "
            "kannala_brandt, not '" +
            name + "'");
    const Value pinhole = root.at("pinhole");
    const auto number = [&](const char* key) { return pinhole.at(key).number(any_number); };
    CameraModel camera;
    camera.width = image_side(pinhole.at("width"));
    camera.height = image_side(pinhole.at("height"));
    camera.intrinsics =
        checked_intrinsics(number("fx"), number("fy"), number("cx"), number("cy"), pinhole.place(),
                           pinhole.number_or_zero("skew", any_number));
    if (name == "kannala_brandt")
        read_kannala_brandt(root, camera);
    else if (name != "pinhole")
        read_radial_tangential(root.at("radial_tangential"), camera);
    if (name == "omnidirectional_universal") {
        const Value offset = root.at("mirror_offset");
        camera.projection =
            checked_projection({Projection::unified, offset.number(any_number)}, offset.place());
    }
    return camera;
}

void write_boofcv_camera(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "a BoofCV file";
    const Projection kind = camera.projection.kind;
    require_foreign_camera(camera, path, format,
                           {Projection::perspective, Projection::unified, Projection::equidistant});
    require_only(camera, kind == Projection::equidistant ? kannala_brandt : first_coefficients(5),
                 path, format);
    const Intrinsics& i = camera.intrinsics;
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
