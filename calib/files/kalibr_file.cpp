#include "calib/files/foreign_camera.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>

#include "calib/files/foreign_value.h"
#include "core/file/text.h"

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

// Kalibr's names of what precedes the focal lengths among the intrinsics, in its order.
struct KalibrModel {
    const char* name;
    Projection projection;
    std::size_t parameters;
    bool has_radtan;
};
constexpr std::array kalibr_models{KalibrModel{"pinhole", Projection::perspective, 0, true},
                                   KalibrModel{"omni", Projection::unified, 1, true},
                                   KalibrModel{"eucm", Projection::extended_unified, 2, false},
                                   KalibrModel{"ds", Projection::double_sphere, 2, false}};

const KalibrModel& kalibr_model(const ForeignValue& value) {
    for (const KalibrModel& model : kalibr_models)
        if (value.text() == model.name)
            return model;
    value.fail("must be pinhole, omni, eucm or ds, not '" + value.text() + "'");
}

// eucm has alpha first, ds xi.
LensProjection kalibr_projection(const KalibrModel& model, const std::vector<double>& numbers) {
    LensProjection projection{model.projection};
    if (model.parameters == 1)
        projection.a = numbers[0];
    else if (model.projection == Projection::extended_unified)
        projection = {model.projection, numbers[1], numbers[0]};
    else if (model.parameters == 2)
        projection = {model.projection, numbers[0], numbers[1]};
    return projection;
}

// A pinhole's distortion may be another projection.
void read_kalibr_distortion(const ForeignValue& values, const KalibrModel& model,
                            CameraModel& camera) {
    const ForeignValue word = values.at("distortion_model");
    const std::string name = word.text();
    const bool is_pinhole = model.projection == Projection::perspective;
    if (name == "none")
        return;
    const ForeignValue coefficients = values.at("distortion_coeffs");
    if (name == "radtan" && model.has_radtan) {
        const auto c = coefficients.numbers(4);
        camera.distortion = {.k1 = c[0], .k2 = c[1], .p1 = c[2], .p2 = c[3]};
    } else if (name == "equidistant" && is_pinhole) {
        camera.projection.kind = Projection::equidistant;
        camera.distortion = kannala_brandt(coefficients.numbers(4));
    } else if (name == "fov" && is_pinhole) {
        camera.projection = checked_projection(
            {Projection::field_of_view, coefficients.numbers(1).front()}, coefficients.place());
    } else {
        word.fail(fmt::format("of {} must be {}, not '{}'", model.name,
                              is_pinhole         ? "radtan, equidistant, fov or none"
                              : model.has_radtan ? "radtan or none"
                                                 : "none",
                              name));
    }
}

}  // namespace

CameraModel read_kalibr_camera(const std::filesystem::path& path, const std::string& name) {
    const ForeignValue chosen =
        choose_camera(ForeignValue::parse(read_text(path), path.string()), name);
    const KalibrModel& model = kalibr_model(chosen.at("camera_model"));
    const ForeignValue intrinsics = chosen.at("intrinsics"), size = chosen.at("resolution");
    const auto i = intrinsics.numbers(model.parameters + 4), sides = size.numbers(2);
    const double* focal = i.data() + model.parameters;
    CameraModel camera;
    camera.projection = checked_projection(kalibr_projection(model, i), intrinsics.place());
    camera.intrinsics = from_pixels_of(
        CalibrationTool::kalibr,
        checked_intrinsics(focal[0], focal[1], focal[2], focal[3], intrinsics.place()));
    read_kalibr_distortion(chosen, model, camera);
    camera.width = checked_image_side(sides[0], size.place());
    camera.height = checked_image_side(sides[1], size.place());
    return camera;
}

void write_kalibr_camera(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "a Kalibr camchain";
    const LensProjection& p = camera.projection;
    require_foreign_camera(
        camera, path, format,
        {Projection::perspective, Projection::equidistant, Projection::field_of_view,
         Projection::unified, Projection::extended_unified, Projection::double_sphere});
    require_no_skew(camera, path, format);
    const Intrinsics i = to_pixels_of(CalibrationTool::kalibr, camera.intrinsics);
    const Distortion& d = camera.distortion;
    std::vector<double> intrinsics{i.fx, i.fy, i.cx, i.cy}, coefficients;
    const char *model = "pinhole", *distortion = "none";
    if (p.kind == Projection::equidistant) {
        require_only(camera, {"k1", "k2", "k3", "k7"}, path, format);
        distortion = "equidistant";
        const auto k = kannala_brandt_coefficients(d);
        coefficients.assign(k.begin(), k.end());
    } else if (p.kind == Projection::perspective || p.kind == Projection::unified) {
        require_only(camera, {"k1", "k2", "p1", "p2"}, path, format);
        distortion = "radtan";
        coefficients = {d.k1, d.k2, d.p1, d.p2};
    } else {
        require_only(camera, {}, path, format);
    }
    if (p.kind == Projection::field_of_view) {
        distortion = "fov";
        coefficients = {p.a};
    } else if (p.kind == Projection::unified) {
        model = "omni";
        intrinsics.insert(intrinsics.begin(), p.a);
    } else if (p.kind == Projection::extended_unified) {
        model = "eucm";
        intrinsics.insert(intrinsics.begin(), {p.b, p.a});
    } else if (p.kind == Projection::double_sphere) {
        model = "ds";
        intrinsics.insert(intrinsics.begin(), {p.a, p.b});
    }
    const auto listed = [](const std::vector<double>& numbers) {
        std::string text;
        for (const double number : numbers)
            text += (text.empty() ? "" : ", ") + yaml_real(number);
        return text;
    };
    write_text(path, fmt::format("cam0:\n"
                                 "  camera_model: {}\n"
                                 "  intrinsics: [{}]\n"
                                 "  distortion_model: {}\n"
                                 "  distortion_coeffs: [{}]\n"
                                 "  resolution: [{}, {}]\n"
                                 "  rostopic: /cam0/image_raw\n",
                                 model, listed(intrinsics), distortion, listed(coefficients),
                                 camera.width, camera.height));
}

}  // namespace etalon
