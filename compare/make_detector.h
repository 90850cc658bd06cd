// Every detector that there is, by name.
#pragma once

#include <memory>

#include "compare/detect/detector.h"

namespace etalon {

// A detector for this marker: "apriltag", "aruco", "topotag", "chessboard", "charuco", "aprilgrid",
// "circles", "squares", "stag"; "aruco-none", "aruco-contour" and "aruco-apriltag" for studies of
// their bias; "auto" for the marker's own. Throws ConfigError at `place` when there is no such
// detector or it cannot see the marker.
std::unique_ptr<Detector> make_detector(const std::string& name, const Marker& marker,
                                        const std::string& place);

// The names that make_detector() takes; "auto" is the first.
std::vector<std::string> detector_names();

// Which tags a photograph shows, without sizes ("apriltag:36h11:7", "aruco:4X4_50:3"): all ids of
// the first family that shows any. The wanted marker's own family comes first, then OpenCV's from
// the most bits to the fewest, which are sometimes seen in anything. Some 10 ms for each family.
std::vector<std::string> tags_in_view(const CodeImage& photo, const Marker& wanted);

}  // namespace etalon
