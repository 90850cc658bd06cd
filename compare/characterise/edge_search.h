// Slanted edges of any photograph, without knowing what it shows: every straight line segment
// (Grompone von Gioi et al., "LSD: a Line Segment Detector", Image Processing On Line 2, 2012) that
// runs 2 to 15 degrees off the pixels' rows or columns is measured in a window around it, as wide
// as its surroundings are even.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "compare/characterise/slanted_edge.h"

namespace etalon {

struct FoundSlantedEdge {
    cv::Rect region;
    SlantedEdge edge;
};

struct SlantedEdges {
    std::vector<FoundSlantedEdge> edges;
    std::string reason;  // why the longest line that cannot be measured cannot; empty: no such line
};

// The edges whose MTF50 is most certain, the best first, none around the middle of another's
// region; at most `most`. Some 50 ns a pixel and a ms an edge. Safe from every thread.
SlantedEdges find_slanted_edges(const LinearPhoto& photo, std::size_t most = 12);

}  // namespace etalon
