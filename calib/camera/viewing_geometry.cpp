#include "calib/camera/viewing_geometry.h"

#include "core/geometry/rigid.h"

namespace etalon {

double depth_mm(const LensProjection& projection, const Eigen::Vector3d& p_camera) {
    return projection.is_flat() ? p_camera.z() : p_camera.norm();
}

Eigen::Quaterniond rotation_to_mean_direction(const std::vector<Eigen::Vector3d>& rays) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& ray : rays)
        mean += ray;
    return rotation_between(mean, Eigen::Vector3d::UnitZ());
}

VisibleProjection seen_across(const Eigen::Quaterniond& turn,
                              const std::vector<Eigen::Vector3d>& rays) {
    constexpr double least_cosine = 0.17;  // of 80 degrees
    VisibleProjection seen;
    for (std::size_t i = 0; i < rays.size(); ++i) {
        const Eigen::Vector3d ray = turn * rays[i];
        if (!(ray.z() > least_cosine))
            continue;
        seen.kept.push_back(i);
        seen.points.push_back(ray.hnormalized());
    }
    return seen;
}

}  // namespace etalon
