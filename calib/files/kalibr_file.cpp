// Calibrations as Kalibr writes them (camchain.yaml; its wiki, "yaml formats"): of every camera
// cam0, cam1, ... camera_model, intrinsics [fu, fv, pu, pv], distortion_model, distortion_coeffs
// and resolution [width, height].
//
// Read and written: pinhole with radtan (k1 k2 p1 p2, OpenCV's order), equidistant, fov or none,
// omni with radtan or none, eucm and ds. Poses are not read. Written is one camera, cam0. Throws
// ConfigError for coefficients beyond k1 k2 p1 p2 (equidistant k1 k2 k3 k7), and for a skew.
#include "calib/files/foreign_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/file/text.h"

namespace etalon {
namespace {

Value choose_camera(const Value& root, const std::string& name) {
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

// What precedes the focal lengths among the intrinsics, in Kalibr's order, and the words for the
// distortions that the model may have.
struct KalibrModel {
    const char* name;
    Projection projection;
    std::vector<double LensProjection::*> parameters;
    const char* distortions;
};
const std::vector<KalibrModel>& kalibr_models() {
    using P = LensProjection;
    static const std::vector<KalibrModel> all{
        {"pinhole", Projection::perspective, {}, "radtan, equidistant, fov or none"},
        {"omni", Projection::unified, {&P::a}, "radtan or none"},
        {"eucm", Projection::extended_unified, {&P::b, &P::a}, "none"},
        {"ds", Projection::double_sphere, {&P::a, &P::b}, "none"}};
    return all;
}

// A pinhole's distortion may be another projection.
const ForeignModels& kalibr_distortions() {
    static const ForeignModels all{{"radtan", Projection::perspective, first_coefficients(4)},
                                   {"equidistant", Projection::equidistant, kannala_brandt},
                                   {"fov", Projection::field_of_view, {"omega"}},
                                   {"none", Projection::perspective, {}}};
    return all;
}

const KalibrModel& kalibr_model(const Value& value) {
    for (const KalibrModel& model : kalibr_models())
        if (value.text() == model.name)
            return model;
    value.fail("must be pinhole, omni, eucm or ds, not '" + value.text() + "'");
}

void read_kalibr_distortion(const Value& values, const KalibrModel& model, CameraModel& camera) {
    const Value word = values.at("distortion_model");
    const std::string name = word.text();
    if (name == "none")
        return;
    const Value coefficients = values.at("distortion_coeffs");
    for (const ForeignModel& known : kalibr_distortions()) {
        if (name != known.name ||
            std::string_view(model.distortions).find(name) == std::string_view::npos)
            continue;
        if (known.projection != Projection::perspective)
            camera.projection.kind = known.projection;
        const std::size_t count = known.parameters.size();
        set_parameters(camera, known.parameters, coefficients.numbers(count, any_number));
        checked_projection(camera.projection, coefficients.place());
        return;
    }
    word.fail(fmt::format("of {} must be {}, not '{}'", model.name, model.distortions, name));
}

// The distortion, and the model, that a camera's projection has in Kalibr's words.
const KalibrModel& model_of(Projection projection) {
    for (const KalibrModel& model : kalibr_models())
        if (model.projection == projection)
            return model;
    return kalibr_models().front();
}
const ForeignModel& distortion_of(Projection projection) {
    const bool is_unified = projection == Projection::unified;
    for (const ForeignModel& known : kalibr_distortions())
        if (known.projection == (is_unified ? Projection::perspective : projection))
            return known;
    return kalibr_distortions().back();
}

}  // namespace

CameraModel read_kalibr_camera(const std::filesystem::path& path, const std::string& select) {
    const Value chosen = choose_camera(foreign_root(read_text(path), path.string()), select);
    const KalibrModel& model = kalibr_model(chosen.at("camera_model"));
    const Value intrinsics = chosen.at("intrinsics");
    const auto i = intrinsics.numbers(model.parameters.size() + 4, any_number);
    CameraModel camera;
    camera.projection.kind = model.projection;
    auto next = i.begin();
    for (double LensProjection::*parameter : model.parameters)
        camera.projection.*parameter = *next++;
    checked_projection(camera.projection, intrinsics.place());
    camera.intrinsics = checked_intrinsics(next[0], next[1], next[2], next[3], intrinsics.place());
    read_kalibr_distortion(chosen, model, camera);
    std::tie(camera.width, camera.height) = image_sides(chosen.at("resolution"));
    return camera;
}

void write_kalibr_camera(const std::filesystem::path& path, const CameraModel& camera) {
    constexpr const char* format = "a Kalibr camchain";
    require_foreign_camera(
        camera, path, format,
        {Projection::perspective, Projection::equidistant, Projection::field_of_view,
         Projection::unified, Projection::extended_unified, Projection::double_sphere});
    require_no_skew(camera, path, format);
    const KalibrModel& model = model_of(camera.projection.kind);
    const ForeignModel& distortion = distortion_of(camera.projection.kind);
    require_only(camera, distortion.parameters, path, format);
    std::vector<double> intrinsics;
    for (double LensProjection::*parameter : model.parameters)
        intrinsics.push_back(camera.projection.*parameter);
    const Intrinsics& i = camera.intrinsics;
    intrinsics.insert(intrinsics.end(), {i.fx, i.fy, i.cx, i.cy});
    write_text(path, fmt::format("cam0:\n"
                                 "  camera_model: {}\n"
                                 "  intrinsics: [{}]\n"
                                 "  distortion_model: {}\n"
                                 "  distortion_coeffs: [{}]\n"
                                 "  resolution: [{}, {}]\n"
                                 "  rostopic: /cam0/image_raw\n",
                                 model.name, yaml_reals(intrinsics), distortion.name,
                                 yaml_reals(parameters_of(camera, distortion.parameters)),
                                 camera.width, camera.height));
}

}  // namespace etalon
