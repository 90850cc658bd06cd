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

#include <string>
#include <vector>

#include "compare/detect/detector.h"
#include "compare/photometric/compared_area.h"
#include "compare/photometric/photo_match.h"
#include "core/image/image.h"
#include "sim/marker/marker.h"

namespace etalon {

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
