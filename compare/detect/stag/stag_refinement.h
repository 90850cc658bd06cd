// The corners of a STag marker from all its edges: where the four sides and the circle are, to a
// small part of a pixel, and the one view of the marker that fits them best.
//
// The publication fits the circle alone, on whole edge pixels, and does nothing where it is not
// found as one closed segment. Here every edge is measured on its own along its normal, by the area
// under the gray profile, which no symmetric blur displaces. A joint least-squares fit with Tukey's
// weights finds the homography, radial distortion, and by how much all edges are displaced
// (compare/detect/stag/stag_edges.h). Method and figures: docs/stag.md.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "compare/detect/stag/stag_reading.h"

namespace etalon {

struct StagRefinement {
    Quad corners;                // from the marker's top left clockwise
    double edge_shift_px = 0.0;  // of all edges towards the light
    double rms_px = 0.0;         // of the edges' distances from the fit
    double sigma_px = 0.0;       // standard deviation of the worst corner's coordinate, from that
};

// `start` has the marker upright, with corners good to two pixels or so; `code` is its word, and
// `contrast` that of its references in `image` (CV_32FC1). Nothing when the edges that are found
// do not fix every corner to a quarter of a pixel (small or hidden markers), or do not fit one
// view. Safe from every thread; about 0.3 ms.
std::optional<StagRefinement> refine_stag(const cv::Mat& image, const Homography& start,
                                          StagCode code, double contrast);

}  // namespace etalon
