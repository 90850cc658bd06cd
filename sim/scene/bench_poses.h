// Poses that fill what a camera can see of a marker, for statistics over poses: Halton points
// (sim/scene/pose_sampling.h). Left out are those that would bring the grid's outline outside the
// image or nearer than 20 px to its border, and those whose plane passes through the lens (part of
// which would see the back). The same arguments give the same poses, and a longer list begins with
// a shorter one. All throw NumericalError when one draw in a thousand or less fits.
#pragma once

#include <cstdint>
#include <vector>

#include "calib/camera/camera_model.h"
#include "core/geometry/rigid.h"
#include "sim/marker/cell_grid.h"

namespace etalon {

// What the camera sees between two depths of the grid's centre, mm, with tilts up to max_tilt, rad.
struct SeenVolume {
    double nearest_mm = 150.0, farthest_mm = 1500.0;
    double max_tilt = 1.2217304763960306;  // 70 degrees
};

// Depth uniform, tilt uniform about any axis in the image plane, any turn in the marker's plane,
// the centre anywhere in the image.
std::vector<Rigid> volume_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed, const SeenVolume& volume);

// From near focus to far: depth of the grid's centre uniform from 150 to 1500 mm, tilt from 0 to 70
// degrees about any axis in the image plane, any turn in the marker's plane, the centre anywhere in
// the image.
std::vector<Rigid> spread_poses(const CameraModel& camera, const CellGrid& grid, int count,
                                std::uint64_t seed);

// The volume of the published comparison of detectors (FMAC, 10 000 images): depth uniform from 500
// to 1500 mm, R = Rz(yaw) Ry(pitch) Rx(roll) with roll and pitch uniform within +-45 degrees and
// any yaw, the marker's origin anywhere in the image (sim/scene/pose_volume.h).
std::vector<Rigid> study_poses(const CameraModel& camera, const CellGrid& grid, int count,
                               std::uint64_t seed);

}  // namespace etalon
