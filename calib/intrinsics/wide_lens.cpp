#include "calib/intrinsics/wide_lens.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "calib/intrinsics/calibration_model.h"
#include "calib/intrinsics/camera_fit.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double max_noise_over_scatter = 1.5, either_angle_deg = 40.0, wide_angle_deg = 50.0;

// Infinite where there is no fit.
struct Misfit {
    double rms_px = std::numeric_limits<double>::infinity();
    double scatter_px = 0.0;  // of neighbouring residuals
    double angle_deg = 0.0;   // of the outermost point to the axis
};

double outermost_angle_deg(std::span<const CalibrationView> views, const CameraFit& fit) {
    double least_cosine = 1.0;
    for (std::size_t v = 0; v < views.size(); ++v)
        for (const Eigen::Vector3d& point : views[v].points_mm)
            least_cosine =
                std::min(least_cosine, (fit.camera_from_target[v] * point).normalized().z());
    return std::acos(std::clamp(least_cosine, -1.0, 1.0)) * 180.0 / std::numbers::pi;
}

Misfit misfit_of(const std::string& model, std::span<const CalibrationView> views, cv::Size size) {
    const auto fit = attempted([&] { return fit_camera(views, size, calibration_model(model)); });
    if (!fit)
        return {};
    double squares = 0.0;
    for (const auto& residuals : fit.value->residuals_px)
        for (const Eigen::Vector2d& residual : residuals)
            squares += residual.squaredNorm();
    return {std::sqrt(squares / static_cast<double>(point_count(views))),
            corner_scatter_px(views, fit.value->residuals_px),
            outermost_angle_deg(views, *fit.value)};
}

}  // namespace

LensAngle lens_angle(std::span<const CalibrationView> views, cv::Size image_size) {
    Misfit perspective;
    for (const char* model : {"standard", "rational"}) {
        const Misfit misfit = misfit_of(model, views, image_size);
        if (misfit.rms_px < perspective.rms_px)
            perspective = misfit;
        if (misfit.rms_px <= max_noise_over_scatter * misfit.scatter_px)
            return perspective.angle_deg < either_angle_deg ? LensAngle::ordinary
                                                            : LensAngle::either;
    }
    for (const CalibrationModel& model : wide_calibration_models()) {
        const Misfit misfit = misfit_of(model.name, views, image_size);
        if (misfit.rms_px < 0.5 * perspective.rms_px && misfit.angle_deg > wide_angle_deg)
            return LensAngle::wide;
    }
    return perspective.angle_deg < either_angle_deg ? LensAngle::ordinary : LensAngle::either;
}

}  // namespace etalon
