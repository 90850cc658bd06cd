// Which tags a photograph shows, whatever they are: for the words about a marker that is not there.
#pragma once

#include <string>
#include <vector>

#include "core/image/image.h"
#include "sim/marker/marker.h"

namespace etalon {

// Names without sizes, "apriltag:36h11:7" or "aruco:4X4_50:3": all ids of the first family that
// shows any. The wanted marker's own family comes first, then those of OpenCV's with the most bits,
// as the smallest ones are sometimes seen in anything. Empty when no tag is seen. Some 10 ms for
// each family that is tried.
std::vector<std::string> tags_in_view(const CodeImage& photo, const Marker& wanted);

}  // namespace etalon
