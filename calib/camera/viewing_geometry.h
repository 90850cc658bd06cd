// Rays that may lie anywhere about a camera, seen by one that looks their way: as points of a
// plane, as the closed forms for a plane's pose want them. Rays are as Projector::ray() has them.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "calib/camera/lens_projection.h"

namespace etalon {

// How far away a point of the camera's frame is, as focus goes: along the axis, of a wide lens
// along the line of sight.
double depth_mm(const LensProjection& projection, const Eigen::Vector3d& p_camera);

// Turns the rays' mean into the axis.
Eigen::Quaterniond rotation_to_mean_direction(const std::vector<Eigen::Vector3d>& rays);

struct VisibleProjection {
    std::vector<std::size_t> kept;        // which rays are less than 80 degrees from the axis then
    std::vector<Eigen::Vector2d> points;  // their X/Z and Y/Z
};
VisibleProjection seen_across(const Eigen::Quaterniond& turn,
                              const std::vector<Eigen::Vector3d>& rays);

}  // namespace etalon
