// Method E: the radiance that a point of the sensor receives through the whole aperture, in closed
// form. Exact for a planar grid, tilt and change of blur across the marker included, whether the
// point is in focus or not.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "sim/scene/marker_view.h"

namespace etalon {

// Areas that straight lines cut from a disk, as fractions of the disk: what the aperture sees past
// one edge (segment) and past two crossing edges (wedge).
//
// Closed forms by Green's theorem. The delicate part is the wedge of nearly parallel lines and of
// lines that cross near the rim; docs/rendering.md says how it is kept accurate to 1e-15.

// The part normal . l + offset >= 0 of the unit disk, cut by a chord.
struct DiskChord {
    Eigen::Vector2d normal;  // unit
    double offset;           // -1 < offset < 1
    double half_length;      // of the chord, sqrt(1 - offset^2)
    double half_angle;       // of the arc that belongs to the part, 0..pi
    double area;             // of the part, as a fraction of the disk's
};

// Needs a unit normal and |offset| < 1.
DiskChord disk_chord(const Eigen::Vector2d& normal, double offset);

// Fraction of the disk that lies in both parts. In [max(0, a + b - 1), min(a, b)] always.
double disk_wedge_area(const DiskChord& a, const DiskChord& b);

// Holds scratch memory: one per thread. The view must outlive it.
class LensAverage {
public:
    explicit LensAverage(const MarkerView& view) : view_(view) {}

    // At an undistorted sensor point; `range` holds every cell that its rays can meet (see
    // MarkerView::footprint). About 10 ns per line and 50 ns per line that crosses the aperture.
    double at(const Eigen::Vector2d& x, const CellRange& range);

private:
    int cut_aperture(int axis, int first, int last, const SensorPoint& point,
                     std::vector<DiskChord>& chords) const;

    const MarkerView& view_;
    std::vector<DiskChord> column_chords_, row_chords_;
};

}  // namespace etalon
