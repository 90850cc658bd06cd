#include "calib/intrinsics/calibration_outliers.h"

#include "calib/intrinsics/calibration_start.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

using Residuals = std::vector<std::vector<Eigen::Vector2d>>;

constexpr double least_view_corners = 6.0;

double robust_scale(std::span<const std::vector<Eigen::Vector2d>> residuals) {
    std::vector<double> sizes;
    for (const auto& view : residuals)
        for (const Eigen::Vector2d& residual : view) {
            sizes.push_back(std::abs(residual.x()));
            sizes.push_back(std::abs(residual.y()));
        }
    return 1.4826 * median(std::move(sizes));
}

// Weights that a view gives its points count as they are.
Residuals in_sigmas(Residuals residuals, std::span<const CalibrationView> views) {
    for (std::size_t v = 0; v < views.size(); ++v)
        for (std::size_t i = 0; i < residuals[v].size(); ++i)
            residuals[v][i] /= views[v].sigma(i);
    return residuals;
}

// Twice, because the first scale is from residuals that outliers have pulled at.
Residuals robust_residuals(std::span<const CalibrationView> views, cv::Size image_size,
                           const CalibrationModel& model) {
    constexpr double pulls_no_harder = 1.5;
    CameraFit fit = fit_camera(views, image_size, model);
    for (int pass = 0; pass < 2; ++pass) {
        const double scale = robust_scale(in_sigmas(fit.residuals_px, views));
        if (!(scale > 0.0))
            break;
        fit = fit_camera(views, image_size, model,
                         {.start = CameraStart{fit.camera, fit.camera_from_target},
                          .huber = pulls_no_harder * scale});
    }
    return in_sigmas(std::move(fit.residuals_px), views);
}

Residuals best_robust_residuals(std::span<const CalibrationView> views, cv::Size image_size,
                                std::span<const CalibrationModel> models,
                                const std::stop_token& stop) {
    std::optional<Residuals> best;
    std::string failure;
    for (const CalibrationModel& model : models) {
        throw_if_stopped(stop);
        auto residuals = attempted([&] { return robust_residuals(views, image_size, model); });
        if (!residuals)
            failure = residuals.cause;
        else if (!best || robust_scale(*residuals) < robust_scale(*best))
            best = std::move(*residuals);
    }
    if (!best)
        throw NumericalError(failure);
    return *best;
}

std::vector<bool> longer_than(std::span<const Eigen::Vector2d> residuals, double limit) {
    std::vector<bool> longer;
    for (const Eigen::Vector2d& residual : residuals)
        longer.push_back(residual.norm() > limit);
    const auto size = static_cast<double>(longer.size());
    const auto count = static_cast<double>(std::count(longer.begin(), longer.end(), true));
    if (count >= outlier_view_corners * size || (count > 0.0 && size - count < least_view_corners))
        longer.assign(longer.size(), true);
    return longer;
}

}  // namespace

std::vector<bool> are_no_planes(std::span<const CalibrationView> views) {
    constexpr double times_the_median = 5.0;
    std::vector<double> misfits;
    for (const CalibrationView& view : views)
        misfits.push_back(plane_misfit(view));
    const double limit = std::max(no_plane_misfit, times_the_median * median(misfits));
    std::vector<bool> none;
    for (const double misfit : misfits)
        none.push_back(misfit > limit);
    return none;
}

CornerMask find_outlier_corners(std::span<const CalibrationView> views, cv::Size image_size,
                                std::span<const CalibrationModel> models,
                                const std::stop_token& stop) {
    const std::vector<bool> no_plane = are_no_planes(views);
    std::vector<CalibrationView> planes;
    for (std::size_t v = 0; v < views.size(); ++v)
        if (!no_plane[v])
            planes.push_back(views[v]);
    const Residuals residuals = best_robust_residuals(planes, image_size, models, stop);
    const double scale = robust_scale(residuals);
    CornerMask mask;
    auto of_plane = residuals.begin();
    for (std::size_t v = 0; v < views.size(); ++v) {
        if (no_plane[v]) {
            mask.emplace_back(views[v].pixels.size(), true);
            continue;
        }
        const double larger = std::max(scale, robust_scale({&*of_plane, 1}));
        mask.push_back(longer_than(*of_plane, std::max(outlier_scales * larger, min_outlier_px)));
        ++of_plane;
    }
    return mask;
}

std::vector<std::size_t> find_outlier_views(std::span<const double> rms_px,
                                            std::span<const double> left_out_rms_px) {
    const double of_fit = median({rms_px.begin(), rms_px.end()});
    const double left_out = median({left_out_rms_px.begin(), left_out_rms_px.end()});
    std::vector<std::size_t> found;
    for (std::size_t i = 0; i < rms_px.size(); ++i)
        if (rms_px[i] > std::max(outlier_view_factor * of_fit, min_outlier_px) &&
            left_out_rms_px[i] > outlier_view_factor * left_out)
            found.push_back(i);
    return found;
}

CalibrationView without_points(const CalibrationView& view, const std::vector<bool>& left_out) {
    CalibrationView rest;
    for (std::size_t i = 0; i < view.pixels.size(); ++i) {
        if (left_out[i])
            continue;
        rest.points_mm.push_back(view.points_mm[i]);
        rest.pixels.push_back(view.pixels[i]);
        rest.ids.push_back(view.ids.empty() ? static_cast<int>(i) : view.ids[i]);
        if (!view.sigma_px.empty())
            rest.sigma_px.push_back(view.sigma_px[i]);
        if (!view.displacements_mm.empty())
            rest.displacements_mm.push_back(view.displacements_mm[i]);
    }
    return rest;
}

}  // namespace etalon
