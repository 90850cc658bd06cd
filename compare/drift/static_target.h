// The points of a target in a photograph, whatever detector of ours finds them.
#pragma once

#include <functional>
#include <string>

#include "compare/drift/target_movement.h"
#include "core/image/image.h"

namespace etalon {

// Empty where the target is not seen. For one thread.
using TargetFinder = std::function<TargetPoints(const CodeImage&)>;

// For every marker and board that has a detector (sim/marker/marker.h,
// compare/detect/board/calibration_target.h). Throws ConfigError at `place` for any other.
TargetFinder make_target_finder(const std::string& spec, const std::string& place);

}  // namespace etalon
