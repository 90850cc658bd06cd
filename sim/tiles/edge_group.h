// Groups of 4 x 4 tiles that see one edge, far from any corner: a pixel there is a function of its
// distance from the edge (sim/psf/edge_table.h), so that nothing is sampled nor filtered.
#pragma once

#include "sim/psf/edge_table.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

// A grid line that alone divides a range of cells: axis 0 is u = index.
struct OneEdge {
    int axis, index;
    double before, beyond;  // radiance
};
std::optional<OneEdge> one_edge(const MarkerView& view, const CellRange& range);

// How the group sees the edge; nothing where the table's bound is above `gray`, or for a wide lens.
std::optional<EdgeGroup> edge_group(const MarkerView& view, const UndistortionMap& map, int i,
                                    int j, const OneEdge& edge, const EdgeTable& response,
                                    double gray);

}  // namespace etalon
