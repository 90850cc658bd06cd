// STags behind the Detector interface.
#pragma once

#include <memory>
#include <string>

#include "compare/detect/detector.h"

namespace etalon {

// Our own finder of STag markers (compare/detect/stag/stag_finder.h), all of whose edges place the
// corners: a marker that is too small or too hidden for that is not found. ConfigError at `place`
// for any other marker.
std::unique_ptr<Detector> make_stag_detector(const Marker& marker, const std::string& place);

}  // namespace etalon
