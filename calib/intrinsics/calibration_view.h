// What a camera is calibrated from: points of a planar target and where one photo shows them.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

namespace etalon {

// One view. The points are in the target's frame, in its plane z = 0.
struct CalibrationView {
    std::vector<Eigen::Vector3d> points_mm;
    std::vector<Eigen::Vector2d> pixels;
    std::vector<int> ids = {};  // of each point on the target; empty: 0, 1, 2, ...
    // Standard deviation of a coordinate of each pixel, up to a common factor, which is estimated
    // from the residuals; empty: all alike.
    std::vector<double> sigma_px = {};

    // Where each point really is, less where the drawing has it; empty: there. Found by
    // calib/intrinsics/board_shape.h.
    std::vector<Eigen::Vector3d> displacements_mm = {};

    Eigen::Vector3d true_point_mm(std::size_t point) const {
        return displacements_mm.empty() ? points_mm[point]
                                        : points_mm[point] + displacements_mm[point];
    }
    double sigma(std::size_t point) const { return sigma_px.empty() ? 1.0 : sigma_px[point]; }
};

// What a calibration takes at least.
inline constexpr std::size_t min_views = 3, min_view_points = 4;

// How far points scatter about what a smooth model would leave, RMS of the distance in px: from how
// each residual differs from the mean of its four nearest neighbours' on the target.
double corner_scatter_px(std::span<const CalibrationView> views,
                         std::span<const std::vector<Eigen::Vector2d>> residuals_px);

// Points of all views.
std::size_t point_count(std::span<const CalibrationView> views);

// Throws NumericalError, naming the view by `index`, unless it has `needed` finite points in
// z = 0, not collinear, as many finite pixels, and sound deviations, displacements and ids.
void check_view(const CalibrationView& view, std::size_t index, std::size_t needed);
// The same of what a calibration takes at least.
void check_views(std::span<const CalibrationView> views);

}  // namespace etalon
