// Method C: the radiance that a small box of the sensor receives, from its exact area in each cell,
// at a few points of the aperture. For (nearly) sharp images, where the edges' blur is far narrower
// than the box.
#pragma once

#include <vector>

#include "sim/scene/marker_view.h"
#include "sim/tiles/square_area.h"

namespace etalon {

struct LensPoint {
    Eigen::Vector2d l_mm;
    double weight;
};

// `rings` x `spokes` points: radii by Gauss-Legendre in the enclosed area, spokes equally spaced,
// every other ring turned by half a spoke. Rings 1..4; spokes 0 gives the lens centre alone.
std::vector<LensPoint> lens_points(double radius_mm, int rings, int spokes);

// Holds scratch memory: one per thread. The view must outlive it.
class CellCoverage {
public:
    CellCoverage(const MarkerView& view, std::vector<LensPoint> points)
        : view_(view), points_(std::move(points)) {}

    // Average over the parallelogram of undistorted sensor points centred on x with these sides
    // (columns). `range` as for LensAverage::at.
    double over(const Eigen::Vector2d& x, const Eigen::Matrix2d& sides, const CellRange& range);

private:
    int cut_box(int axis, int first, int last, const Eigen::Vector2d& x, const SensorPoint& point,
                const Eigen::Matrix2d& sides, const Eigen::Vector2d& l,
                std::vector<SquareCut>& cuts) const;

    const MarkerView& view_;
    std::vector<LensPoint> points_;
    std::vector<SquareCut> column_cuts_, row_cuts_;
};

}  // namespace etalon
