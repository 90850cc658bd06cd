#include "calib/intrinsics/calibration_model.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/program/errors.h"

namespace etalon {
namespace {

// The models are heads of one list: OpenCV appended to its coefficients as its model grew.
CalibrationModel first_parameters(const char* name, std::size_t count) {
    CalibrationModel model{name, {intrinsic_names.begin(), intrinsic_names.end()}};
    model.parameters.insert(model.parameters.end(), distortion_names.begin(),
                            distortion_names.begin() + (count - intrinsic_names.size()));
    return model;
}

}  // namespace

const std::vector<CalibrationModel>& calibration_models() {
    static const std::vector<CalibrationModel> models{
        first_parameters("pinhole", 4),  first_parameters("radial", 6),
        first_parameters("standard", 9), first_parameters("rational", 12),
        first_parameters("prism", 16),   first_parameters("tilted", 18),
    };
    return models;
}

const std::vector<CalibrationModel>& wide_calibration_models() {
    using enum Projection;
    static const std::vector<CalibrationModel> models{
        {"field_of_view", {"fx", "fy", "cx", "cy", "omega"}, field_of_view},
        {"double_sphere", {"fx", "fy", "cx", "cy", "xi", "alpha"}, double_sphere},
        {"extended_unified", {"fx", "fy", "cx", "cy", "beta", "alpha"}, extended_unified},
        {"kannala_brandt", {"fx", "fy", "cx", "cy", "k1", "k2", "k3", "k7"}, equidistant},
        {"omnidirectional", {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "xi"}, unified},
    };
    return models;
}

const std::vector<CalibrationModel>& telecentric_calibration_models() {
    using enum Projection;
    static const std::vector<CalibrationModel> models{
        {"telecentric", {"fx", "fy"}, telecentric},
        {"telecentric_radial", {"fx", "fy", "cx", "cy", "k1", "k2"}, telecentric},
        {"telecentric_standard",
         {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"},
         telecentric},
    };
    return models;
}

const std::vector<CalibrationModel>& calibration_models_beside(Projection projection) {
    return projection == Projection::perspective   ? calibration_models()
           : projection == Projection::telecentric ? telecentric_calibration_models()
                                                   : wide_calibration_models();
}

const std::vector<CalibrationModel>& perspective_and_wide_models() {
    static const std::vector<CalibrationModel> models = [] {
        std::vector<CalibrationModel> all = calibration_models();
        const auto prism = std::ranges::find(all, "prism", &CalibrationModel::name);
        all.insert(prism, wide_calibration_models().begin(), wide_calibration_models().end());
        return all;
    }();
    return models;
}

int pose_parameters(Projection projection) {
    return projection == Projection::telecentric ? 5 : 6;
}

const CalibrationModel& calibration_model(std::string_view name) {
    std::vector<std::string> names;
    for (const auto* models :
         {&calibration_models(), &wide_calibration_models(), &telecentric_calibration_models()})
        for (const CalibrationModel& model : *models) {
            if (model.name == name)
                return model;
            names.push_back(model.name);
        }
    throw ConfigError({}, fmt::format("no calibration model is named '{}'; there are {}", name,
                                      fmt::join(names, ", ")));
}

CameraParameters all_parameters(const CameraModel& camera) {
    const Intrinsics& i = camera.intrinsics;
    const auto coefficients = camera.distortion.coefficients();
    CameraParameters values;
    values << i.fx, i.fy, i.cx, i.cy,
        Eigen::Map<const Eigen::Matrix<double, Distortion::count, 1>>(coefficients.data()),
        camera.projection.a, camera.projection.b, i.skew;
    return values;
}

void set_all_parameters(CameraModel& camera, const CameraParameters& values) {
    camera.intrinsics = {values[0], values[1], values[2], values[3], values[21]};
    std::array<double, Distortion::count> coefficients{};
    std::copy_n(values.begin() + 4, coefficients.size(), coefficients.begin());
    camera.distortion = Distortion::of(coefficients);
    camera.projection.a = values[19];
    camera.projection.b = values[20];
}

int parameter_index(std::string_view name) {
    for (std::size_t i = 0; i < intrinsic_names.size(); ++i)
        if (name == intrinsic_names[i])
            return static_cast<int>(i);
    for (std::size_t i = 0; i < distortion_names.size(); ++i)
        if (name == distortion_names[i])
            return static_cast<int>(intrinsic_names.size() + i);
    for (const ProjectionName& projection : projection_names())
        for (std::size_t i = 0; i < projection.parameters.size(); ++i)
            if (!name.empty() && name == projection.parameters[i])
                return static_cast<int>(intrinsic_names.size() + distortion_names.size() + i);
    if (name == "skew")
        return camera_parameter_count - 1;
    throw ConfigError({}, fmt::format("a camera has no parameter '{}'", name));
}

Eigen::VectorXd parameters_of(const CameraModel& camera, const CalibrationModel& model) {
    const CameraParameters all = all_parameters(camera);
    Eigen::VectorXd values(model.parameters.size());
    for (std::size_t i = 0; i < model.parameters.size(); ++i)
        values[i] = all[parameter_index(model.parameters[i])];
    return values;
}

void set_parameters(CameraModel& camera, const CalibrationModel& model,
                    const Eigen::VectorXd& values) {
    if (values.size() != static_cast<Eigen::Index>(model.parameters.size()))
        throw NumericalError(fmt::format("{} values for the {} parameters of model {}",
                                         values.size(), model.parameters.size(), model.name));
    CameraParameters all = all_parameters(camera);
    for (std::size_t i = 0; i < model.parameters.size(); ++i)
        all[parameter_index(model.parameters[i])] = values[i];
    set_all_parameters(camera, all);
}

}  // namespace etalon
