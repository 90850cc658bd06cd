// Every detector that there is, by name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "compare/detect/detector.h"

namespace etalon {

// A detector for this marker: "apriltag", "aruco", "topotag", "chessboard", "charuco",
// "aprilgrid", "circles", "squares" or "stag";
// "auto" takes the one that belongs to the marker. ArUco's other ways to place corners, for studies
// of their bias, are "aruco-none", "aruco-contour" and "aruco-apriltag". Options:
// compare/detect/detector_adaptors.h. Throws ConfigError (at `place`) when there is no such
// detector or it cannot see the marker.
std::unique_ptr<Detector> make_detector(const std::string& name, const Marker& marker,
                                        const std::string& place);

// The names that make_detector() takes; "auto" is the first.
std::vector<std::string> detector_names();

}  // namespace etalon
