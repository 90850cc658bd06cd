// Views of one set that were taken with different cameras: another zoom or focus, another camera of
// the same image size. One camera fitted to them all is none of theirs, and outlier rules would
// blame views that are as good as the others.
//
// Two groups are looked for: split by each view's own wish for another focal length or centre, and
// by the order of the views; then each view goes to the group whose camera it fits better, until
// none moves (Lloyd, "Least squares quantization in PCM", 1982). Whether two cameras are needed is
// Chow's test (Econometrica 28, 1960) on what is left of the views' equations: with p parameters
// for all and q more for the second group of n views in all, D the drop of the sum of squares and R
// the equations' residual,
//
//     F = (D / q) / (R / (n p - p - q))
//
// R is of whole views, not of points, so that what the points of one photo share (blur, a bent
// board) counts as noise, and its degrees of freedom count views by how alike they err. The split
// is the best of all: each of the C(n, m) that have m views aside is allowed an equal part of the
// false alarm rate, so that it holds for the best one too. A model too poor for the lens errs alike
// in photos that are alike: the split that the standard model finds must be needed with the richest
// model as well. Of a wide lens both are Kannala and Brandt's; of a telecentric one the centre is
// held, which p1 and p2 make up for.
#pragma once

#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "calib/intrinsics/calibration_view.h"

namespace etalon {

// Of honest sets whose views err independently, at most this share is split. So low because those
// of photos are not all as independent and as normal as that: one board bent anew for every photo.
inline constexpr double mixed_views_false_alarms = 1e-5;
inline constexpr std::size_t min_mixed_views = 5;  // fewer are not looked at

struct CameraGroup {
    std::vector<std::size_t> views;  // ascending
    // Mean of fx and fy, and its standard deviation; of less than three views with all else as the
    // others have it. Of a telecentric lens px per mm. Zero when there is one group.
    double focal_px = 0.0, deviation_px = 0.0;
};

// The groups of views that share a camera, the largest first; one group for an honest set, for
// fewer than five views, and where no camera fits them. Views in an order that no plane shows have
// no say and are in the largest. Views must have passed check_view(). Some twenty fits: 0.2 s for
// 13 views of 54 points.
std::vector<CameraGroup> camera_groups(std::span<const CalibrationView> views, cv::Size image_size,
                                       bool is_telecentric = false);

}  // namespace etalon
