// Views through a telecentric lens of a 9x6 board of 2 mm squares, made by projection alone.
#pragma once

#include <cmath>

#include "tests/calib/synthetic_views.h"

namespace etalon::test {

// 25 mm x 19 mm; at the corners k1 makes 4 px of distortion, k2 3 px, k3 1.5 px.
inline CameraModel telecentric_truth() {
    CameraModel camera =
        camera_with(640, 480, {25.3, 24.9, 331.0, 226.0},
                    {.k1 = -4.1e-5, .k2 = 1.3e-7, .p1 = 1.9e-5, .p2 = -3.1e-5, .k3 = -2.3e-10});
    camera.projection.kind = Projection::telecentric;
    return camera;
}

// Tilted by 20 to 45 degrees every way, over all of the image.
inline Rigid telecentric_pose(int view) {
    const double turn = 2.4 * view;  // the golden angle: no two views alike
    const double tilt = 0.57 + 0.2 * std::sin(3 * turn);
    const Eigen::Quaterniond rotation =
        rotation_from_vector({0, 0, 0.2 * std::sin(5 * turn)}) *
        rotation_from_vector({tilt * std::cos(turn), tilt * std::sin(turn), 0});
    const Eigen::Vector3d place(3.1 * (view % 3 - 1) - 0.3, 3.0 * (view / 3 % 3 - 1) + 0.4,
                                80.0 + 5.0 * std::sin(4 * turn));
    return {rotation, place - rotation * Eigen::Vector3d(8, 5, 0)};
}

inline CalibrationView telecentric_view(const CameraModel& camera, const Rigid& camera_from_board,
                                        double noise_px, int seed) {
    return synthetic_view(camera, camera_from_board, noise_px, seed, 2.0);
}

inline std::vector<CalibrationView> telecentric_views(const CameraModel& camera, int count,
                                                      double noise_px, int seed,
                                                      Rigid (*pose)(int) = telecentric_pose) {
    return synthetic_views(camera, count, noise_px, seed, pose, 2.0);
}

}  // namespace etalon::test
