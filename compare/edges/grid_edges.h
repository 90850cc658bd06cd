// The edges of a cell grid: pieces of its lines with a darker cell on one side and a lighter one on
// the other, as long as they go on alike. Where they are in a photograph:
// compare/edges/edge_spread.h and compare/edges/edge_shifts.h.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/marker/cell_grid.h"

namespace etalon {

// All cells before the line share one radiance and all cells after it another, for `reach` cells
// away from it on either side.
struct GridEdge {
    int axis;               // 0: u = line, 1: v = line (grid coordinates, in cells)
    int line, first, last;  // cells along it, last included
    int reach_before, reach_after;
    bool rises;      // radiance grows with u (v)
    float contrast;  // difference of the two radiances, above 0

    int cells() const { return last - first + 1; }
    // Grid coordinates of a place along it: `along` from first to last + 1.
    Eigen::Vector2d at(double along) const {
        return axis == 0 ? Eigen::Vector2d(line, along) : Eigen::Vector2d(along, line);
    }
};

// Lines of constant u first, each from the lower end on. The grid's outline is no edge: what is
// beside the grid is not known.
std::vector<GridEdge> grid_edges(const CellGrid& grid);

}  // namespace etalon
