// The two closed-form methods in double precision (docs/rendering.md, "E" and "C"), and the areas
// that straight lines cut from a disk and from a square, as fractions.
#pragma once

#include "sim/scene/marker_view.h"

namespace etalon {

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

// Fraction of the disk that lies in both parts, to 1e-15. In [max(0, a + b - 1), min(a, b)] always.
double disk_wedge_area(const DiskChord& a, const DiskChord& b);

// Method E: the radiance that a point of the sensor receives through the whole aperture. Holds
// scratch memory: one per thread. The view must outlive it.
class LensAverage {
public:
    explicit LensAverage(const MarkerView& view) : view_(view) {}

    // At an undistorted sensor point; `range` holds every cell that its rays can meet (see
    // MarkerView::footprint). About 10 ns per line and 50 ns per line that crosses the aperture.
    double at(const Eigen::Vector2d& x, const CellRange& range);

private:
    const MarkerView& view_;
    std::vector<DiskChord> column_chords_, row_chords_;
};

// The square [-1/2, 1/2]^2: closed form for one line; clipping of its outline (Sutherland and
// Hodgman, 1974) for two.

// The part offset + gradient . s >= 0 of the square.
struct SquareCut {
    Eigen::Vector2d gradient;
    double offset;
    double area;  // of the part
};

// Any finite values; a zero gradient gives 0 or 1.
SquareCut square_cut(const Eigen::Vector2d& gradient, double offset);

// The inverse: the offset of the cut that has this area, 0..1. Needs a gradient that is not zero.
double offset_of_area(const Eigen::Vector2d& gradient, double area);

// Fraction of the square that lies in both parts.
double square_wedge_area(const SquareCut& a, const SquareCut& b);

struct LensPoint {
    Eigen::Vector2d l_mm;
    double weight;
};

// Rings 1..4: radii by Gauss-Legendre in the enclosed area, spokes equally spaced, every other ring
// turned by half a spoke. Spokes 0: the lens centre alone.
struct LensRule {
    int rings, spokes;
    int points() const { return spokes == 0 ? 1 : rings * spokes; }
};
std::vector<LensPoint> lens_points(double radius_mm, const LensRule& rule);

// Method C: the radiance that a small box of the sensor receives, from its exact area in each cell,
// at a few points of the aperture. Memory and view as above.
class CellCoverage {
public:
    CellCoverage(const MarkerView& view, std::vector<LensPoint> points)
        : view_(view), points_(std::move(points)) {}

    // Average over the parallelogram of undistorted sensor points centred on x with these sides
    // (columns). `range` as for LensAverage::at.
    double over(const Eigen::Vector2d& x, const Eigen::Matrix2d& sides, const CellRange& range);

private:
    const MarkerView& view_;
    std::vector<LensPoint> points_;
    std::vector<SquareCut> column_cuts_, row_cuts_;
};

}  // namespace etalon
