// Views of one set taken with different cameras: another zoom, focus or camera of the same size.
// One camera fitted to all is none of theirs, and outlier rules would reject good views.
//
// Splits into two groups are tried in the order of the views and of each view's change of focal
// length and centre; then each view goes to the group that fits it better (Lloyd, "Least squares
// quantization in PCM", 1982). Two cameras are needed where Chow's test
// (Econometrica 28, 1960) says so: with p parameters for all, q more for the second group, n views,
// D the drop of the sum of squares and R the residual of the views' equations,
//
//     F = (D / q) / (R / (n p - p - q)).
//
// R counts whole views: errors common to a photo are noise. The best split is of many: each of the
// C(n, m) with m views in the second group gets an equal part of the false alarm rate. One found
// with the standard model must be needed with the richest too. Wide lenses have Kannala and
// Brandt's model; a telecentric centre is held, since p1 and p2 make up. More: docs/calibration.md.
#pragma once

#include <opencv2/core.hpp>

#include "calib/intrinsics/calibration_view.h"

namespace etalon {

// At most this share of sets from one camera is split if views err independently. It is so low
// because photos are less independent and less normal than that.
inline constexpr double mixed_views_false_alarms = 1e-5;
inline constexpr std::size_t min_mixed_views = 5;  // fewer are not looked at

struct CameraGroup {
    std::vector<std::size_t> views;  // ascending
    // Mean of fx and fy, and its standard deviation. Fewer than three views share all else with the
    // others. Telecentric: px per mm. Zero when there is one group.
    double focal_px = 0.0, deviation_px = 0.0;
};

// The groups of views that share a camera, the largest first. One group for fewer than five views
// and where no camera fits; views that no plane shows are in the largest. Needs checked views. Some
// twenty fits: 0.2 s for 13 views of 54 points.
std::vector<CameraGroup> camera_groups(std::span<const CalibrationView> views, cv::Size image_size,
                                       bool is_telecentric = false);

}  // namespace etalon
