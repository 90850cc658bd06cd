// Findings that speak against calling a photograph and its rendering a match: a photograph is
// matched only when there is none.
//
// Each finding is a test: a measured value and its limit. A limit is above what noise gives (five
// standard deviations) and above what a good lens and JPEG at quality 50 leave
// (docs/match-outcome.md). The sentence names all causes that may leave the trace. A finding may be
// a refusal: the figures of that photograph mean nothing, and enter no mean. Not seen is the size
// of the print: marker and distance twice as large give the same photograph.
#pragma once

#include "compare/detect/detector.h"
#include "compare/photometric/photo_match.h"

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

// Refusals before anything is fitted: whether all of this marker is there at this pose, exposed and
// sharp enough. The pose may be wrong by a third of a cell. A few ms; up to seconds where another
// id is searched for. Safe from every thread. Throws NumericalError when the photograph has another
// size than the camera.
Findings examine_marker(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                        const Projector& projector, const Rigid& camera_from_marker);

// The above at the refined pose and, without a refusal, what is left between photograph and
// rendering. About 0.1 s of CPU time for a board that fills 640x480 px. Safe from every thread.
Findings examine_match(const CodeImage& photo, const Marker& marker, const ComparedArea& area,
                       const PhotometricCamera& camera, const PhotoMatch& match);

// Why a detector may have found nothing: dark, empty, saturated; or it does find the marker in the
// negative, mirrored or reduced photograph (value and limit are then 0). Five detections at most.
Findings examine_missing_marker(const CodeImage& photo, Detector& detector);

}  // namespace etalon
