// The sum that both closed-form methods share. A window (the aperture, or a pixel's box) is crossed
// by some consecutive grid lines of each direction; its average radiance is
//     base cell + sum over lines of (contrast along the base row or column) * (area beyond)
//               + sum over crossings of (mixed difference of the four cells) * (area beyond both).
#pragma once

#include <vector>

#include "sim/scene/marker_view.h"

namespace etalon {

// `column_cuts[n]` is the window's part beyond the line u = base_column + 1 + n, and so on. A cut
// has a member `area`; wedge_area(a, b) is the area beyond both. All areas are fractions of the
// window.
template <class Cut, class WedgeArea>
double sum_of_cells(const MarkerView& view, int base_column, int base_row,
                    const std::vector<Cut>& column_cuts, const std::vector<Cut>& row_cuts,
                    WedgeArea wedge_area) {
    double sum = view.cell(base_column, base_row);
    int column = base_column;
    for (const Cut& cut : column_cuts) {
        ++column;
        sum += (view.cell(column, base_row) - view.cell(column - 1, base_row)) * cut.area;
    }
    int row = base_row;
    for (const Cut& row_cut : row_cuts) {
        ++row;
        sum += (view.cell(base_column, row) - view.cell(base_column, row - 1)) * row_cut.area;
        column = base_column;
        for (const Cut& cut : column_cuts) {
            ++column;
            const double mixed = view.cell(column, row) - view.cell(column - 1, row) -
                                 view.cell(column, row - 1) + view.cell(column - 1, row - 1);
            if (mixed != 0.0)
                sum += mixed * wedge_area(cut, row_cut);
        }
    }
    return sum;
}

}  // namespace etalon
