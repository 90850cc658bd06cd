#include "core/geometry/roll_pitch_yaw.h"

#include <cmath>
#include <numbers>

namespace etalon {

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
