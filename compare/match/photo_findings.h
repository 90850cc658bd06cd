// What stands in the way of calling a photograph and its rendering a match: a list of findings.
// A photograph is matched only when there is none.
//
// Each finding is a test: a measured value and its limit. A limit has two parts where both make
// sense: the value must be more than noise gives (five standard deviations) and larger than what a
// good lens and JPEG at quality 50 leave (docs/match-outcome.md has each limit's reason, and the
// smallest fault that each test finds). Several causes may leave the same trace; a finding's
// sentence then names all of them.
//
// A finding may be a refusal: the figures of that photograph mean nothing, and enter no mean. The
// residual of a photograph with any other finding does enter: a mean over photographs that were
// chosen for their residuals would flatter.
//
// Not seen at all: the size of the print. Marker and distance twice as large give the same
// photograph.
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <vector>

#include "compare/detect/detector.h"
#include "compare/photometric/compared_area.h"
#include "compare/photometric/photo_match.h"
#include "compare/photometric/photometric_model.h"
#include "core/image/image.h"
#include "sim/marker/marker.h"

namespace etalon {

// Where a photograph differs from its rendering by a good part of the contrast over more than an
// edge's width: something covers the marker, or shines on it.
//
// The residual is averaged over square windows of a third of a cell, but at least 3 px, beside the
// edges: a displaced or blurred edge is another fault. Cells of 4 px and less have no such places.

struct CoveredAreas {
    double largest = 0.0;       // of all windows, in parts of the contrast
    double share = 0.0;         // of the compared pixels that lie in windows above the limit
    double bright_share = 0.0;  // of those that are brighter than the marker's white or clipped
    cv::Mat pixels;             // CV_8UC1, 255: in such a window, or within a pixel of it
};

// `limit` in parts of the contrast (white minus black of the photometric model at the place). The
// windows' side is in px. Safe from every thread. Throws NumericalError when sizes differ.
CoveredAreas covered_areas(const cv::Mat& photo_gray, const PhotoFit& fit, double window_px,
                           double limit, double saturation_gray);

// What strong JPEG compression leaves: steps between blocks of 8 x 8 px where the marker is flat.
// Only for whole photographs: a cut or scaled one has its blocks elsewhere.

struct BlockSteps {
    // RMS difference of neighbouring pixels' residuals, gray: across the borders of blocks and
    // inside them. 0 where there are no flat pairs.
    double across_gray = 0.0, inside_gray = 0.0;
    int pairs = 0;  // across borders

    // What the borders add: sqrt(across^2 - inside^2), or 0.
    double excess_gray() const;
};

// Of the compared pixels whose prediction changes by less than 1 % of `contrast_gray` per px.
BlockSteps block_steps(const PhotoFit& fit, double contrast_gray);

struct Finding {
    // For files, never renamed: not_in_image, marker_not_there, wrong_marker, turned, upside_down,
    // mirrored, negative, saturated, low_contrast, out_of_focus, occluded, glare, motion_blur,
    // sharpened, blur_differs, skewed, calibration_mismatch, compressed, unexplained.
    std::string name;
    double value = 0.0, limit = 0.0;
    std::string unit;      // "px", "%", "gray"; empty for a ratio
    std::string sentence;  // for a technician
    bool is_not_assessable = false;
};

using Findings = std::vector<Finding>;

inline bool is_matched(const Findings& findings) {
    return findings.empty();
}
bool is_refused(const Findings& findings);

// What is seen before anything is fitted: is this marker there at this pose, all of it, exposed
// and sharp enough? Refusals only. An error of the pose of a third of a cell does no harm. A few
// ms; up to seconds where another id of a large family has to be found. Safe from every thread.
// Throws NumericalError when the photograph has another size than the camera.
Findings examine_marker(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                        const Projector& projector, const Rigid& camera_from_marker);

// All of it: the above at the refined pose, then what is left between photograph and rendering
// there. After a refusal nothing more is looked for. About 0.1 s of CPU time for a board that
// fills a photograph of 640x480 px. Safe from every thread.
Findings examine_match(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                       const PhotometricCamera& camera, const PhotoMatch& match);

// Why a detector may have found nothing in a photograph: dark, empty, saturated; or it does find
// the marker in the negative, mirrored or reduced photograph. Empty when none of that helps.
// Values and limits are those of the cause, or 0 where something was only tried. Five detections
// at most.
Findings examine_missing_marker(const CodeImage& photo, Detector& detector);

}  // namespace etalon
