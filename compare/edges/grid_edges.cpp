#include "compare/edges/grid_edges.h"

#include <cmath>

namespace etalon {
namespace {

class CellView {
public:
    CellView(const CellGrid& grid, int axis) : grid_(grid), axis_(axis) {}
    int lines() const { return axis_ == 0 ? grid_.columns() : grid_.rows(); }
    int length() const { return axis_ == 0 ? grid_.rows() : grid_.columns(); }
    float at(int across, int along) const {
        return axis_ == 0 ? grid_.cells.at<float>(along, across)
                          : grid_.cells.at<float>(across, along);
    }
    // How many cells from `across` on in this direction are like it, over the whole run.
    int reach(int across, int direction, int first, int last) const {
        const float value = at(across, first);
        int count = 0;
        for (int c = across; c >= 0 && c < lines(); c += direction, ++count)
            for (int along = first; along <= last; ++along)
                if (at(c, along) != value)
                    return count;
        return count;
    }

private:
    const CellGrid& grid_;
    int axis_;
};

void add_edges_of_line(const CellView& cells, int axis, int line, std::vector<GridEdge>& edges) {
    for (int first = 0; first < cells.length();) {
        const float before = cells.at(line - 1, first), after = cells.at(line, first);
        int last = first;
        while (last + 1 < cells.length() && cells.at(line - 1, last + 1) == before &&
               cells.at(line, last + 1) == after)
            ++last;
        if (before != after)
            edges.push_back({axis, line, first, last, cells.reach(line - 1, -1, first, last),
                             cells.reach(line, 1, first, last), after > before,
                             std::abs(after - before)});
        first = last + 1;
    }
}

}  // namespace

std::vector<GridEdge> grid_edges(const CellGrid& grid) {
    std::vector<GridEdge> edges;
    for (const int axis : {0, 1}) {
        const CellView cells(grid, axis);
        for (int line = 1; line < cells.lines(); ++line)
            add_edges_of_line(cells, axis, line, edges);
    }
    return edges;
}

}  // namespace etalon
