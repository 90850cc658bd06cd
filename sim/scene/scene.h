// What is before the camera: flat markers at their poses, and what shows behind them.
#pragma once

#include <vector>

#include "core/geometry/rigid.h"
#include "core/image/image.h"
#include "sim/marker/cell_grid.h"

namespace etalon {

struct CameraModel;

struct PlacedMarker {
    CellGrid grid;
    Rigid camera_from_marker;
};

struct Scene {
    std::vector<PlacedMarker> markers;
    double background = 1.0;  // radiance everywhere outside the grids
};

// The turn about the camera's centre after which a wide lens looks at the marker: the mean
// direction of its corners becomes the axis. None of a flat projection.
Eigen::Quaterniond turn_towards(const PlacedMarker& marker, const CameraModel& camera);
PlacedMarker turned(const PlacedMarker& marker, const Eigen::Quaterniond& turn);

// Throws NumericalError when a corner of a marker before a wide lens is 80 degrees or more from
// that direction.
void check_reach(const Scene& scene, const CameraModel& camera);

// The closed-form methods add up the markers' differences: no ray through the lens may meet two
// markers. That holds for markers side by side in one plane (touching, seams to 2e-5 px) and images
// farther apart than the lens looks behind the nearer one. Other pairs are refused, and of a wide
// lens those that span 160 degrees and are not well apart. Needs check_scene(). Throws
// NumericalError that names both markers, from 1, or one that reaches behind the lens.
void check_no_occlusion(const Scene& scene, const CameraModel& camera);

}  // namespace etalon
