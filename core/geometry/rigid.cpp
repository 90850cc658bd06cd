#include "core/geometry/rigid.h"

#include <cmath>
#include <numbers>

namespace etalon {

Eigen::Quaterniond rotation_between(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
    const Eigen::Vector3d a = from.normalized(), b = to.normalized();
    const Eigen::Vector3d sum = a + b;  // exact where it is small: near opposite directions
    const double twice_squared_cosine = 0.5 * sum.squaredNorm();  // of half the angle
    const Eigen::Vector3d axis = twice_squared_cosine > 1e-30 ? a.cross(sum) : a.unitOrthogonal();
    return Eigen::Quaterniond(twice_squared_cosine, axis.x(), axis.y(), axis.z()).normalized();
}

Eigen::Quaterniond rotation_from_vector(const Eigen::Vector3d& v) {
    const double angle = v.norm();
    // sin(a/2)/a by its series where the quotient would lose digits; the next term is a^4/3840.
    const double scale = angle < 1e-3 ? 0.5 - angle * angle / 48.0 : std::sin(angle / 2.0) / angle;
    return Eigen::Quaterniond(std::cos(angle / 2.0), scale * v.x(), scale * v.y(), scale * v.z())
        .normalized();
}

Eigen::Vector3d rotation_vector(const Eigen::Quaterniond& rotation) {
    // q and -q are the same rotation: the one with w >= 0 has the shorter vector.
    const double sign = rotation.w() < 0.0 ? -1.0 : 1.0;
    const Eigen::Vector3d v = sign * rotation.vec();
    const double w = sign * rotation.w(), length = v.norm();
    // angle/sin(angle/2) by its series near 0; atan2 keeps full precision up to pi.
    const double scale = length < 1e-6 ? 2.0 / w : 2.0 * std::atan2(length, w) / length;
    return scale * v;
}

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
    Eigen::Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

Rigid rigid_from_vector(const Vector6d& pose) {
    return {rotation_from_vector(pose.head<3>()), pose.tail<3>()};
}

Vector6d vector_from_rigid(const Rigid& transform) {
    Vector6d pose;
    pose << rotation_vector(transform.rotation), transform.translation;
    return pose;
}

Rigid left_perturbed(const Rigid& transform, const Vector6d& delta) {
    return {(rotation_from_vector(delta.head<3>()) * transform.rotation).normalized(),
            transform.translation + delta.tail<3>()};
}

Vector6d left_difference(const Rigid& from, const Rigid& to) {
    Vector6d delta;
    delta << rotation_vector(to.rotation * from.rotation.conjugate()),
        to.translation - from.translation;
    return delta;
}

Eigen::Quaterniond rotation_from_roll_pitch_yaw(const Eigen::Vector3d& angles) {
    using Eigen::AngleAxisd, Eigen::Vector3d;
    return Eigen::Quaterniond(AngleAxisd(angles.z(), Vector3d::UnitZ()) *
                              AngleAxisd(angles.y(), Vector3d::UnitY()) *
                              AngleAxisd(angles.x(), Vector3d::UnitX()));
}

Eigen::Vector3d roll_pitch_yaw(const Eigen::Quaterniond& rotation) {
    constexpr double min_cosine = 1e-7;  // of the pitch; below, rounding decides roll and yaw
    const Eigen::Matrix3d r = rotation.toRotationMatrix();
    const double cosine = std::hypot(r(2, 1), r(2, 2)), pitch = std::atan2(-r(2, 0), cosine);
    if (cosine < min_cosine)
        return {0.0, pitch, std::atan2(-r(0, 1), r(1, 1))};
    return {std::atan2(r(2, 1), r(2, 2)), pitch, std::atan2(r(1, 0), r(0, 0))};
}

double wrapped(double angle) {
    return std::remainder(angle, 2.0 * std::numbers::pi);
}

}  // namespace etalon
