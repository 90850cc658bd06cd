// Poses that fill what a camera can see of a marker, for statistics over poses.
#pragma once

#include <cstdint>
#include <vector>

#include "calib/camera_model.h"
#include "core/rigid.h"
#include "sim/cell_grid.h"

namespace etalon {

// Depth of the grid's centre uniform from 150 to 1500 mm, tilt from 0 to 70 degrees about any axis
// in the image plane, any turn in the marker's plane, the centre anywhere in the image; Halton
// points (sim/pose_sampling.h) of which those are left out that would bring a corner of the grid
// nearer than 20 px to the image's border or outside, or whose plane passes through the lens (part
// of which would see the back). The same arguments give the same poses, and more of them begin with
// the fewer. Throws NumericalError when one draw in a thousand or less fits.
std::vector<Rigid> spread_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed);

}  // namespace etalon
