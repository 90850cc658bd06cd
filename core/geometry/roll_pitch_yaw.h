// Rotations as roll, pitch and yaw, for people and for studies whose axes they are:
//
//     R = Rz(yaw) Ry(pitch) Rx(roll)
//
// turns about the camera's z axis last. The published comparison of markers (FMAC) states its
// angles so. Not for computing: at a pitch of +-90 degrees only yaw - roll or yaw + roll is
// determined.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace etalon {

// (roll, pitch, yaw), rad.
Eigen::Quaterniond rotation_from_roll_pitch_yaw(const Eigen::Vector3d& angles);

// Its inverse: roll and yaw in [-pi, pi], pitch in [-pi/2, pi/2]; never NaN. Rounding errors of
// roll and yaw grow like 1 / cos(pitch); within 1e-7 of +-90 degrees of pitch the roll is said to
// be 0.
Eigen::Vector3d roll_pitch_yaw(const Eigen::Quaterniond& rotation);

// The same angle in [-pi, pi], for differences of angles.
double wrapped(double angle);

}  // namespace etalon
