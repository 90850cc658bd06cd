// Views of the board of synthetic_views.h around a wide lens.
#pragma once

#include "tests/calib/synthetic_views.h"

namespace etalon::test {

// 200 degrees along the image's width.
inline CameraModel wide_truth(LensProjection projection, double focal, Distortion distortion = {}) {
    CameraModel camera = camera_with(640, 480, {focal, 0.99 * focal, 331.0, 243.0}, distortion);
    camera.projection = projection;
    return camera;
}

// Boards 250 to 350 mm away, tilted up to 35 degrees against the line of sight, whose middles lie
// up to 72 degrees from the axis: their corners reach beyond 90.
inline Rigid wide_pose(int view) {
    const double turn = 2.4 * view, angles[] = {0.15, 0.75, 1.25};
    const double angle = angles[view % 3];
    const Eigen::Vector3d sight(std::sin(angle) * std::cos(turn), std::sin(angle) * std::sin(turn),
                                std::cos(angle));
    const Eigen::Quaterniond facing =
        rotation_between(Eigen::Vector3d::UnitZ(), sight);
    const Eigen::Quaterniond rotation =
        facing * rotation_from_vector({0.55 * std::cos(3 * turn), 0.5 * std::sin(2 * turn),
                                       0.15 * std::sin(5 * turn)});
    return {rotation,
            (300.0 + 50.0 * std::sin(4 * turn)) * sight - rotation * Eigen::Vector3d(100, 62.5, 0)};
}

inline std::vector<CalibrationView> wide_views(const CameraModel& camera, int count,
                                               double noise_px, int seed) {
    return synthetic_views(camera, count, noise_px, seed, wide_pose);
}

// Each wide model with a lens that it follows.
struct WideModel {
    const char* name;
    CameraModel truth;
};
inline std::vector<WideModel> wide_models() {
    using enum Projection;
    return {
        {"field_of_view", wide_truth({field_of_view, 0.93}, 190.0)},
        {"double_sphere", wide_truth({double_sphere, -0.17, 0.59}, 155.0)},
        {"extended_unified", wide_truth({extended_unified, 1.09, 0.63}, 190.0)},
        {"kannala_brandt",
         wide_truth({equidistant}, 181.0, {.k1 = 0.031, .k2 = -0.014, .k3 = 0.0021, .k7 = -2e-4})},
        {"omnidirectional", wide_truth({unified, 1.31}, 430.0,
                                       {.k1 = -0.11, .k2 = 0.07, .p1 = 0.0012, .p2 = -0.0007})}};
}

}  // namespace etalon::test
