// A plane as it is seen around its points: px from mm by one homography, least squares over points,
// to place windows with. Distortion is left to who looks there.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace etalon {

struct SeenPlane {
    Eigen::Matrix3d pixel_from_mm;

    // Nothing when the points do not determine it.
    static std::optional<SeenPlane> through(const std::vector<Eigen::Vector2d>& mm,
                                            const std::vector<Eigen::Vector2d>& pixels);

    Eigen::Vector2d at(const Eigen::Vector2d& mm) const;
    Eigen::Matrix2d px_per_mm(const Eigen::Vector2d& mm) const;  // derivative
};

}  // namespace etalon
