// Rigid transforms between named frames. The frames live in the variable's name and chain by eye:
//     Rigid camera_from_marker = camera_from_base * base_from_carriage * carriage_from_marker;
//
// Lengths in mm, angles in rad. Conventions (frames, perturbation, order): docs/conventions.md.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace etalon {

// Rotation then translation, the order of every pose vector and covariance of this project.
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

struct Rigid {
    Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  // unit
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();         // mm

    Eigen::Vector3d operator*(const Eigen::Vector3d& point) const {
        return rotation * point + translation;
    }
    Rigid operator*(const Rigid& other) const {
        return {(rotation * other.rotation).normalized(), *this * other.translation};
    }
    Rigid inverse() const {
        const Eigen::Quaterniond back = rotation.conjugate();
        return {back, -(back * translation)};
    }
};

// Rotation vector (axis times angle, rad) to quaternion and back. rotation_vector() returns the
// shortest one, |v| <= pi. Both are accurate to rounding for every angle, 0 and pi included.
Eigen::Quaterniond rotation_from_vector(const Eigen::Vector3d& rotation_vector);

// The smallest rotation that takes one direction to another (of any length, not zero); about any
// axis across them where they are opposite.
Eigen::Quaterniond rotation_between(const Eigen::Vector3d& from, const Eigen::Vector3d& to);
Eigen::Vector3d rotation_vector(const Eigen::Quaterniond& rotation);

// [v]x, the matrix of the cross product: cross_matrix(v) * w == v.cross(w).
Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v);

// [rx ry rz tx ty tz] as on the command line: rotation vector (rad), translation (mm).
Rigid rigid_from_vector(const Vector6d& pose);
Vector6d vector_from_rigid(const Rigid& transform);

// The left perturbation that covariances refer to: R' = Exp(delta[0..2]) R, t' = t + delta[3..5].
Rigid left_perturbed(const Rigid& transform, const Vector6d& delta);

// The delta that takes `from` to `to`: left_perturbed(from, left_difference(from, to)) == to.
Vector6d left_difference(const Rigid& from, const Rigid& to);

// Rotations as roll, pitch and yaw, for people and studies: R = Rz(yaw) Ry(pitch) Rx(roll), turns
// about the camera's z axis last, as in the published comparison of markers (FMAC). Not for
// computing: at +-90 degrees of pitch only yaw - roll or yaw + roll is determined.

// (roll, pitch, yaw), rad.
Eigen::Quaterniond rotation_from_roll_pitch_yaw(const Eigen::Vector3d& angles);

// Its inverse: roll and yaw in [-pi, pi], pitch in [-pi/2, pi/2]; never NaN. Rounding of roll and
// yaw grows like 1 / cos(pitch); within 1e-7 of +-90 degrees the roll is 0.
Eigen::Vector3d roll_pitch_yaw(const Eigen::Quaterniond& rotation);

// The same angle in [-pi, pi], for differences of angles.
double wrapped(double angle);

}  // namespace etalon
