// Corners and whole views that do not fit the others: a corner taken for its neighbour, a photo of
// a board that moved. What is found is named and counted, never dropped silently.
//
//  - Scale: 1.4826 times the median size of the residuals' coordinates (Huber, "Robust Statistics",
//    1981), from a fit in which points beyond 1.5 scales pull no harder. A corner is an outlier
//    beyond six scales of all views or of its own, whichever is larger.
//  - A view is an outlier when a quarter of its corners are, when less than six are left, or when
//  it
//    is three times as bad as the median view both in the fit and left out of it.
//  - A view is no view of the target when its points are further from every homography of the
//    target's plane than a tenth of its extent, and than five times the median view.
#pragma once

#include <stop_token>

#include "calib/intrinsics/camera_fit.h"

namespace etalon {

inline constexpr double outlier_scales = 6.0;
inline constexpr double min_outlier_px = 0.1;  // shorter residuals are never outliers
inline constexpr double outlier_view_corners = 0.25;
inline constexpr double outlier_view_factor = 3.0;
inline constexpr double no_plane_misfit =
    0.1;  // see plane_misfit() of calib/intrinsics/calibration_start.h

// By view and point.
using CornerMask = std::vector<std::vector<bool>>;

// Corners by the first rule, under the model with the smallest scale; all of a view that is an
// outlier or no view of the target. Throws NumericalError, from the last model, when none fits, and
// Interrupted after a stop.
CornerMask find_outlier_corners(std::span<const CalibrationView> views, cv::Size image_size,
                                std::span<const CalibrationModel> models,
                                const std::stop_token& stop = {});

// By view, by the third rule. Such a view has no pose that a robust fit could hold on to.
std::vector<bool> are_no_planes(std::span<const CalibrationView> views);

// Views by the second rule, from each view's residual in the fit and left out.
std::vector<std::size_t> find_outlier_views(std::span<const double> rms_px,
                                            std::span<const double> left_out_rms_px);

// The view without the points that are set.
CalibrationView without_points(const CalibrationView& view, const std::vector<bool>& left_out);

}  // namespace etalon
