// Blur along a target that is tilted through focus: in the photograph and, as the camera's file has
// it, in the rendering.
//
// The width of an edge is the variance of the Gaussian that, behind the pixel's box, fits its
// pixels best (compare/edges/edge_fit.h): measured on the photograph and on the rendering in the
// same way, so that the two can be compared however the blur is shaped and however far they are
// apart. A thin lens draws a point at depth z as a disk of radius R = a fx |1/z - 1/z_f| px, a the
// aperture's radius, of variance R^2 / 4: over inverse depth the widths lie close to a parabola,
// lowest in focus. Its place is the photograph's focus distance, whatever the camera's file says.
// Its height is only nearly right, as a disk is no Gaussian:
// compare/characterise/defocus_estimate.h fits f-number and focus distance to the pixels.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "compare/edges/edge_shifts.h"
#include "compare/edges/edge_spread.h"

namespace etalon {

// Edges between two depths.
struct DepthBin {
    double low_mm = 0.0, high_mm = 0.0;
    int edges = 0;
    double depth_mm = 0.0;  // 1 / mean of 1/z
    // Variance along the normal, without the pixel: mean over the edges weighted by their own
    // deviations; its deviation from these, or from the scatter among the edges where larger.
    double measured_px2 = 0.0, measured_deviation_px2 = 0.0;
    double rendered_px2 = 0.0;
    // Of the edges of edge_shifts() between these depths: RMS of the residual along them.
    double residual_rms_gray = 0.0;
};

// Where the widths are least.
struct WidthMinimum {
    bool is_determined = false;
    std::string undetermined;  // when not, why; then the values are 0
    double focus_distance_mm = 0.0, standard_uncertainty_mm = 0.0;
};

struct DefocusProfile {
    std::vector<DepthBin> bins;  // of equal ranges in 1/z, the nearest first; none without edges
    int edges = 0;               // measured in both images
    WidthMinimum photo;
    // Of the rendering: what the camera's file says, seen in the same way. It has no noise; its
    // uncertainty says how well a parabola describes the widths.
    WidthMinimum rendering;
};

// `rendering` is linear radiance, CV_32FC1, with the camera's blur, at this pose, and `shifts` are
// the edges of the same photograph at the same pose (for the residuals). `selection`'s clearance is
// to cover the widest blur disk. Throws NumericalError for a telecentric camera, fewer than one bin
// and sizes that differ. A millisecond an edge. Safe from every thread.
DefocusProfile defocus_profile(const CodeImage& photo, const Radiance& rendering,
                               const Projector& projector, const Marker& marker,
                               const Rigid& camera_from_marker, const ComparedArea& area,
                               std::span<const EdgeShift> shifts,
                               const EdgeSelection& selection = {}, int bins = 8);

}  // namespace etalon
