// Corners and whole views that do not fit the others: a corner taken for its neighbour, a photo of
// a board that moved. What is found is named and counted, never dropped silently.
//
// The rules are simple enough to be repeated by hand:
//  - scale: 1.4826 times the median of the residuals' coordinates, without their sign (for normal
//    errors the standard deviation; Huber, "Robust Statistics", 1981), from a fit in which a far
//    point pulls no harder than one at 1.5 scales. A corner is an outlier when its residual is more
//    than six scales long, the scale of all views or of its own, whichever is larger.
//  - a view is an outlier when a quarter of its corners are (or less than six are left), or when it
//    is three times as bad as the median view both in the fit and left out of it. Both: a view that
//    alone sees a corner of the image is badly predicted by the others without being wrong.
//  - a view is no view of the target, and is left out before any fit, when its points are further
//    from every homography of the target's plane than a tenth of its extent, and than five times
//    the median view: its points are in a wrong order.
#pragma once

#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "calib/intrinsics/calibration_view.h"
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

// Corners by the first rule, under whichever of the models has the smallest scale. A view that is
// an outlier, or no view of the target, has all of its corners set. Throws NumericalError, from the
// last model, when none fits.
CornerMask find_outlier_corners(std::span<const CalibrationView> views, cv::Size image_size,
                                std::span<const CalibrationModel> models);

// By view, by the third rule. Such a view has no pose that a robust fit could hold on to.
std::vector<bool> are_no_planes(std::span<const CalibrationView> views);

// Views by the second rule, from each view's residual in the fit and left out.
std::vector<std::size_t> find_outlier_views(std::span<const double> rms_px,
                                            std::span<const double> left_out_rms_px);

// The view without the points that are set.
CalibrationView without_points(const CalibrationView& view, const std::vector<bool>& left_out);

}  // namespace etalon
