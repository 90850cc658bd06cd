#include "calib/intrinsics/identifiability.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "calib/intrinsics/telecentric_start.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

// The pixels' sigma that the mean weight belongs to.
double typical_sigma(std::span<const CalibrationView> views) {
    double weights = 0.0;
    for (const CalibrationView& view : views)
        for (std::size_t i = 0; i < view.pixels.size(); ++i)
            weights += 1.0 / (view.sigma(i) * view.sigma(i));
    return std::sqrt(static_cast<double>(point_count(views)) / weights);
}

// Exact views of bad geometry have no residuals to tell of it: pixels are taken to be no better
// than 0.1 px.
double noise_of(std::span<const CalibrationView> views, const CameraFit& fit) {
    constexpr double min_noise_px = 0.1;
    return std::max(std::sqrt(fit.variance), min_noise_px / typical_sigma(views));
}

bool frees(const CalibrationModel& model, std::string_view parameter) {
    return std::ranges::find(model.parameters, parameter) != model.parameters.end();
}

// A plane tells the magnification along the axis that it is tilted about: of relative changes of fx
// and fy cos^2 of the one and sin^2 of the other. Where all tell nearly the same, what else they
// seem to tell is noise in the directions of their axes, however small. A tilt of a few degrees may
// be that of the camera above a table, common to all views, for which flat on does as well.
void check_tilts(const CameraFit& fit, std::span<const ViewEquations> equations, double noise) {
    constexpr double max_share = 0.01, least_ratio = 0.01;
    Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
    for (std::size_t v = 0; v < equations.size(); ++v) {
        const auto columns = equations[v].triangle.leftCols<2>();
        if (tilt_rad(fit.camera_from_target[v].rotation) > hardly_tilted_rad)
            information += columns.transpose() * columns;
    }
    const Intrinsics& i = fit.camera.intrinsics;
    const Eigen::Matrix2d of_shares = Eigen::Vector2d(i.fx, i.fy).asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
        Eigen::MatrixXd(of_shares * information * of_shares));
    const double least = eigen.eigenvalues()[0], most = eigen.eigenvalues()[1];
    if (!(least > least_ratio * most && least * max_share * max_share > noise * noise))
        throw NumericalError(
            "these views do not tell fy / fx of a telecentric camera: planes are needed that are "
            "tilted by 15 degrees or more, about the image's rows and about its columns");
}

void check_focal_length(const std::string& name, double value, double deviation,
                        std::span<const ViewEquations> equations, const CalibrationModel& model) {
    constexpr double max_share = 0.1;
    if (!(deviation < max_share * value))
        throw NumericalError(
            fmt::format("these views do not determine the focal length: {} {:.5g} with a standard "
                        "deviation of {:.2g} px; views of different tilt are needed, weakest is {}",
                        name, value, deviation, weakest_direction(equations, model).combination));
}

// Without distortion its centre is nowhere, whatever noise makes of it.
void check_centre(const std::string& name, double deviation, const CameraFit& fit,
                  const CalibrationModel& model) {
    if (!(deviation < 0.5 * std::max(fit.camera.width, fit.camera.height)))
        throw NumericalError(fmt::format(
            "these views do not determine the centre of the distortion: {} has a standard "
            "deviation of {:.2g} px; the distortion is too weak for model {}",
            name, deviation, model.name));
}

}  // namespace

void check_determinacy(std::span<const CalibrationView> views, const CameraFit& fit,
                       const CalibrationModel& model, std::span<const ViewEquations> equations) {
    const double noise = noise_of(views, fit);
    const bool is_telecentric = model.projection == Projection::telecentric;
    if (is_telecentric && frees(model, "fx") && frees(model, "fy"))
        check_tilts(fit, equations, noise);
    const Eigen::MatrixXd inverse = inverse_information(equations, model);
    const Eigen::VectorXd values = parameters_of(fit.camera, model);
    for (Eigen::Index i = 0; i < values.size(); ++i) {
        const std::string& name = model.parameters[static_cast<std::size_t>(i)];
        const double deviation = noise * std::sqrt(inverse(i, i));
        if (name == "fx" || name == "fy")
            check_focal_length(name, values[i], deviation, equations, model);
        else if (is_telecentric && (name == "cx" || name == "cy"))
            check_centre(name, deviation, fit, model);
    }
}

}  // namespace etalon
