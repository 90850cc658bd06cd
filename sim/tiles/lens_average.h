// Method E: the radiance that a point of the sensor receives through the whole aperture, in closed
// form. Exact for a planar grid, tilt and change of blur across the marker included, whether the
// point is in focus or not.
#pragma once

#include <vector>

#include "sim/scene/marker_view.h"
#include "sim/tiles/disk_area.h"

namespace etalon {

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
