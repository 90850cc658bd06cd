// Groups of 4 x 4 tiles that see one edge, far from any corner: a pixel there is a function of its
// distance from the edge (sim/psf/edge_table.h), so that nothing is sampled nor filtered.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "sim/psf/edge_table.h"
#include "sim/scene/marker_view.h"
#include "sim/tiles/undistortion_map.h"

namespace etalon {

// What a group's pixels see: differences from the background.
struct EdgeGroup {
    static constexpr int level = 1, side_px = UndistortionMap::group_side * tile_px;

    int i, j;  // indices, as in UndistortionMap
    // The distance from the edge, px, positive beyond it, in a scale that has the blur's rim at
    // `blur` px: the coefficient of s^i t^j at [4 j + i], s and t from -0.5 to 0.5 across the
    // group.
    std::array<float, 16> distance;
    float blur;      // radius, px along the distance
    float diagonal;  // sin^2 of twice the edge's direction
    float before, beyond;
};

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

// The averages of the group's squares of 2 x 2 px before any point spread, 8 x 8 row by row.
// Within 1e-2 gray of the mean over the square of an edge blurred by 3 px.
void edge_averages(const EdgeGroup& group, float* averages);

// Adds the response to the rows from `first` to before `end`; `out`: the pixel of the group's first
// column in the row `first`. `profile` of the group's blur, of which `energy` is the filter's.
void add_edge(const EdgeGroup& group, const EdgeProfile& profile, float energy, int first, int end,
              float* out, std::ptrdiff_t stride);

}  // namespace etalon
