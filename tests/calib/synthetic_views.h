// Views of a 9x6 board, made by projection alone.
#pragma once

#include "calib/camera/projector.h"
#include "calib/intrinsics/calibrate.h"
#include "core/statistics/random.h"
#include "tests/calib/cameras.h"

namespace etalon::test {

const cv::Size image_size(640, 480);  // of calibration_truth()

inline CameraModel calibration_truth() {
    return camera_with(640, 480, {541.0, 533.0, 331.0, 243.0},
                       {.k1 = -0.27, .k2 = 0.09, .p1 = 0.0012, .p2 = -0.0007, .k3 = -0.02});
}

// Boards tilted up to 35 degrees every way, 400 to 600 mm away, all of them inside the image.
inline Rigid synthetic_pose(int view) {
    const double turn = 2.4 * view;  // the golden angle: no two views alike
    const Eigen::Vector3d tilt(0.6 * std::cos(turn), 0.5 * std::sin(turn),
                               0.15 * std::sin(5 * turn));
    const Eigen::Quaterniond rotation = rotation_from_vector(tilt);
    const Eigen::Vector3d centre(100, 62.5, 0);
    const Eigen::Vector3d place(25 * std::sin(3 * turn), 15 * std::cos(2 * turn),
                                500 + 90 * std::sin(4 * turn));
    return {rotation, place - rotation * centre};
}

inline CalibrationView synthetic_view(const CameraModel& camera, const Rigid& camera_from_board,
                                      double noise_px, int seed, double square_mm = 25.0) {
    const Projector projector(camera);
    RandomStream random(seed, 1);
    CalibrationView view;
    for (int row = 0; row < 6; ++row)
        for (int column = 0; column < 9; ++column) {
            view.points_mm.emplace_back(square_mm * column, square_mm * row, 0.0);
            const Eigen::Vector2d noise(random.normal(), random.normal());
            view.pixels.push_back(
                projector.project(camera_from_board * view.points_mm.back()).value() +
                noise_px * noise);
        }
    return view;
}

inline std::vector<CalibrationView> synthetic_views(const CameraModel& camera, int count,
                                                    double noise_px, int seed,
                                                    Rigid (*pose)(int) = synthetic_pose,
                                                    double square_mm = 25.0) {
    std::vector<CalibrationView> views;
    for (int i = 0; i < count; ++i)
        views.push_back(synthetic_view(camera, pose(i), noise_px, 1000 * seed + i, square_mm));
    return views;
}

}  // namespace etalon::test
