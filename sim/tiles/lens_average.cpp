#include "sim/tiles/lens_average.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "sim/tiles/cell_sum.h"

namespace etalon {
namespace {

using std::numbers::pi;

// The chords cross at P inside the disk and b's normal lies counter-clockwise of a's by
// 0 < turn < pi. Walked counter-clockwise the wedge is: along b's arc and a's arc to the end of
// a's chord, along that chord to P, along b's chord back to its beginning.
double crossed_area(const DiskChord& a, const DiskChord& b, double turn, double sine,
                    double cosine) {
    // P's coordinate on a's chord, from its middle along the normal turned by +90 degrees, and on
    // b's. The second comes from the first, not from the same formula: the errors that a division
    // by a tiny sine brings then cancel in the sum.
    const double s_a =
        std::clamp((a.offset * cosine - b.offset) / sine, -a.half_length, a.half_length);
    const double s_b = std::clamp(a.offset * sine + s_a * cosine, -b.half_length, b.half_length);
    // The arc is known without a choice between theta and theta + 2 pi.
    const double arc = a.half_angle + b.half_angle - turn;
    const double twice_area =
        arc + a.offset * (a.half_length - s_a) + b.offset * (b.half_length + s_b);
    return twice_area / (2.0 * pi);
}

}  // namespace

DiskChord disk_chord(const Eigen::Vector2d& normal, double offset) {
    DiskChord chord;
    chord.normal = normal;
    chord.offset = offset;
    chord.half_length = std::sqrt((1.0 - offset) * (1.0 + offset));
    chord.half_angle = std::atan2(chord.half_length, -offset);
    // Of a sliver, angle and chord cancel to third order: the difference must not come out
    // negative.
    chord.area = std::clamp((chord.half_angle + offset * chord.half_length) / pi, 0.0, 1.0);
    return chord;
}

double disk_wedge_area(const DiskChord& a, const DiskChord& b) {
    const double sine = a.normal.x() * b.normal.y() - a.normal.y() * b.normal.x();
    const double cosine = a.normal.dot(b.normal);
    if (sine < 0.0)
        return disk_wedge_area(b, a);
    const double turn = std::atan2(sine, cosine);
    // Where the chords do not cross, one of these angles is not negative: how far the arcs are
    // apart, overlap at both ends, or lie inside each other. The largest decides, so that rounding
    // can only choose between cases with the same area.
    const double apart = turn - (a.half_angle + b.half_angle);
    const double around = a.half_angle + b.half_angle + turn - 2.0 * pi;
    const double a_inside_b = b.half_angle - a.half_angle - turn;
    const double b_inside_a = a.half_angle - b.half_angle - turn;
    const double largest = std::max({apart, around, a_inside_b, b_inside_a});
    double area;
    if (largest < 0.0)
        area = crossed_area(a, b, turn, sine, cosine);
    else if (largest == apart)
        area = 0.0;
    else if (largest == around)
        area = a.area + b.area - 1.0;
    else
        area = largest == a_inside_b ? a.area : b.area;
    const double least = std::max(0.0, a.area + b.area - 1.0);
    return std::clamp(area, least, std::max(least, std::min(a.area, b.area)));
}

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
