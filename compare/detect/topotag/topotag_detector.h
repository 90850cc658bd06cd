// TopoTags behind the Detector interface.
#pragma once

#include <memory>
#include <string>

#include "compare/detect/detector.h"

namespace etalon {

// The TopoTag finder of compare/detect/topotag/topotag_finder.h. ConfigError at `place` for any
// other marker.
std::unique_ptr<Detector> make_topotag_detector(const Marker& marker, const std::string& place);

}  // namespace etalon
