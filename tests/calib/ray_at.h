// Rays by their angle to the axis and about it.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>

namespace etalon::test {

inline constexpr double pi = std::numbers::pi;

inline Eigen::Vector3d ray_at(double angle, double azimuth, double length = 1.0) {
    return length * Eigen::Vector3d(std::sin(angle) * std::cos(azimuth),
                                    std::sin(angle) * std::sin(azimuth), std::cos(angle));
}

}  // namespace etalon::test
