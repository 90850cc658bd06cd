// The edges of a STag marker and where they are in an image, each measured on its own.
#pragma once

#include <optional>
#include <vector>

#include "compare/detect/stag/stag_view.h"

namespace etalon {

// A point of a side or of the circle, in sides of the black square.
struct StagEdge {
    Eigen::Vector2d place;
    Eigen::Vector2d to_light;  // unit normal, from the dark to the light
    double dark_room = 0.0;    // free of other edges on each side of it, along the normal
    double light_room = 0.0;
    double room_along = 0.0;  // to the next corner
};

// Evenly along the four sides and around the circle, where the code leaves the circle room.
std::vector<StagEdge> stag_edges(StagCode code);

// An edge where the image has it, compared with where the view has it.
struct MeasuredEdge {
    Eigen::Vector2d normal;  // unit, in the image, from the dark to the light
    double offset_px = 0.0;  // along it, from view.pixel(place) and the view's shift
};

// From the grey profile along the edge's normal, `reach_px` to either side at most: with the levels
// of both its ends, the area under it says where a step between them would be. A symmetric blur
// does not change that. `contrast` is the marker's; nothing for an edge of less than a third of it,
// one too near another for a profile, and one not wholly in the image (CV_32FC1).
std::optional<MeasuredEdge> measure_edge(const cv::Mat& image, const StagView& view,
                                         const StagEdge& edge, double reach_px, double contrast);

}  // namespace etalon
