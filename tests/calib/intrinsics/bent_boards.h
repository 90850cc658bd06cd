// Views of boards whose points are not where the drawing has them.
#pragma once

#include <functional>

#include "tests/calib/synthetic_views.h"

namespace etalon::test {

using Displacement = std::function<Eigen::Vector3d(const Eigen::Vector3d& drawn_mm, int id)>;

// 0.4 mm from the middle to the ends of the 200 mm, a little of it across.
inline Eigen::Vector3d bow(const Eigen::Vector3d& p, int) {
    const double x = (p.x() - 100.0) / 100.0, y = (p.y() - 62.5) / 100.0;
    return {0.0, 0.0, 0.4 * x * x - 0.1 * y * y};
}
inline Eigen::Vector3d twist(const Eigen::Vector3d& p, int) {
    return {0.0, 0.0, 0.5 * (p.x() - 100.0) / 100.0 * (p.y() - 62.5) / 62.5};
}
inline Eigen::Vector3d scatter(const Eigen::Vector3d&, int id) {
    RandomStream random(7, 2, static_cast<std::uint64_t>(id));
    const double x = random.normal(), y = random.normal(), z = random.normal();
    return {0.04 * x, 0.04 * y, 0.1 * z};
}
inline Eigen::Vector3d flat(const Eigen::Vector3d&, int) {
    return Eigen::Vector3d::Zero();
}

// Views of synthetic_pose() with every displaced point's pixel and normal noise. Their points
// are as drawn.
inline std::vector<CalibrationView> views_of(const Displacement& displacement, int count,
                                             double noise_px, int seed) {
    const Projector projector(calibration_truth());
    std::vector<CalibrationView> views = synthetic_views(calibration_truth(), count, 0.0, 1);
    for (int v = 0; v < count; ++v) {
        RandomStream random(static_cast<std::uint64_t>(seed), 3, static_cast<std::uint64_t>(v));
        CalibrationView& view = views[std::size_t(v)];
        for (std::size_t i = 0; i < view.pixels.size(); ++i) {
            const Eigen::Vector3d& p = view.points_mm[i];
            const double x = random.normal(), y = random.normal();
            view.pixels[i] =
                projector.project(synthetic_pose(v) * (p + displacement(p, static_cast<int>(i))))
                    .value() +
                noise_px * Eigen::Vector2d(x, y);
        }
    }
    return views;
}

}  // namespace etalon::test
