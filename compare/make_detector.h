// Every detector that there is, by name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "compare/detect/detector.h"
#include "core/image/image.h"
#include "sim/marker/marker.h"

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

// Which tags a photograph shows, whatever they are: for the words about a marker that is not there.

// Names without sizes, "apriltag:36h11:7" or "aruco:4X4_50:3": all ids of the first family that
// shows any. The wanted marker's own family comes first, then those of OpenCV's with the most bits,
// as the smallest ones are sometimes seen in anything. Empty when no tag is seen. Some 10 ms for
// each family that is tried.
std::vector<std::string> tags_in_view(const CodeImage& photo, const Marker& wanted);

}  // namespace etalon
