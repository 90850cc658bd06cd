#include "sim/tiles/lens_average.h"

#include "sim/tiles/cell_sum.h"

namespace etalon {

// Returns the index of the cell before the first line that crosses the aperture.
int LensAverage::cut_aperture(int axis, int first, int last, const SensorPoint& point,
                              std::vector<DiskChord>& chords) const {
    const double radius = view_.aperture().radius_mm;
    chords.clear();
    int base = first;
    for (int i = first + 1; i <= last; ++i) {
        const LensLine line = view_.lens_line(axis, i, point);
        const double slope = line.slope.norm(), reach = radius * slope;
        if (line.offset >= reach) {  // every ray passes beyond it, and so beyond all before it
            base = i;
            chords.clear();
        } else if (line.offset <= -reach) {  // no ray reaches it, nor any after it
            break;
        } else {
            chords.push_back(disk_chord(line.slope / slope, line.offset / reach));
        }
    }
    return base;
}

double LensAverage::at(const Eigen::Vector2d& x, const CellRange& range) {
    if (range.is_single())
        return view_.cell(range.first_column, range.first_row);
    const SensorPoint point = view_.sensor_point(x);
    const int column =
        cut_aperture(0, range.first_column, range.last_column, point, column_chords_);
    const int row = cut_aperture(1, range.first_row, range.last_row, point, row_chords_);
    return sum_of_cells(view_, column, row, column_chords_, row_chords_, disk_wedge_area);
}

}  // namespace etalon
