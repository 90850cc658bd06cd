// Targets that a camera is calibrated with, and what a photograph shows of them.
//
//   chessboard:9x6@25mm               inner corners across x down
//
// A target is a board of sim/marker.h, which can be printed, placed in a scene and rendered; here
// is what finds its points in photographs: in our pixel convention (docs/conventions.md), to
// sub-pixel, each with its index on the target. Not for single tags and their poses:
// compare/detector.h. How far off the points are, by kind: docs/calibration.md, "Targets".
#pragma once

#include <optional>
#include <string>

#include "calib/calibrate.h"
#include "core/image.h"
#include "sim/marker.h"

namespace etalon {

struct CalibrationTarget {
    Marker board;
};

// Throws ConfigError at `place` for what sim/marker.h cannot parse and for a marker that is no
// board with points enough to calibrate with (single tags, bitmaps, boards of less than 3x3).
CalibrationTarget parse_calibration_target(const std::string& spec, const std::string& place);

// The target's points in a photograph; nothing when it is not seen. A chessboard is seen whole or
// not at all, and `ids` stays empty. Another target's photograph gives nothing. Never throws for
// what an image holds. The same image gives the same result; safe from every thread. Some 10 ms for
// 640x480 px, up to a second where there is no target.
std::optional<CalibrationView> observe(const CalibrationTarget& target, const CodeImage& image);

}  // namespace etalon
