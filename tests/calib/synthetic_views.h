// Views of a 9x6 board through many lenses, made by projection alone.
#pragma once

#include <functional>

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
            const Eigen::Vector2d noise{random.normal(), random.normal()};
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

// The same for OpenCV's functions, in single precision.
struct OpenCvViews {
    std::vector<std::vector<cv::Point3f>> points;
    std::vector<std::vector<cv::Point2f>> pixels;
};
inline OpenCvViews opencv_views(const std::vector<CalibrationView>& views) {
    OpenCvViews all;
    for (const CalibrationView& view : views) {
        all.points.emplace_back();
        all.pixels.emplace_back();
        for (std::size_t i = 0; i < view.pixels.size(); ++i) {
            all.points.back().emplace_back(view.points_mm[i].x(), view.points_mm[i].y(), 0);
            all.pixels.back().emplace_back(view.pixels[i].x(), view.pixels[i].y());
        }
    }
    return all;
}

// Through a telecentric lens, of a board of 2 mm squares.

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

// Around a wide lens.

// 200 degrees along the image's width.
inline CameraModel wide_truth(LensProjection projection, double focal, Distortion distortion = {}) {
    CameraModel camera = camera_with(640, 480, {focal, 0.99 * focal, 331.0, 243.0}, distortion);
    camera.projection = projection;
    return camera;
}

// Boards tilted up to 35 degrees against the line of sight, which lies at one of the angles to the
// axis; within 50 mm of the distance.
inline Rigid pose_aside(int view, const std::array<double, 3>& angles, double distance_mm) {
    const double turn = 2.4 * view, angle = angles[std::size_t(view % 3)];
    const Eigen::Vector3d sight(std::sin(angle) * std::cos(turn), std::sin(angle) * std::sin(turn),
                                std::cos(angle));
    const Eigen::Quaterniond facing = rotation_between(Eigen::Vector3d::UnitZ(), sight);
    const Eigen::Quaterniond rotation =
        facing * rotation_from_vector({0.55 * std::cos(3 * turn), 0.5 * std::sin(2 * turn),
                                       0.15 * std::sin(5 * turn)});
    return {rotation, (distance_mm + 50.0 * std::sin(4 * turn)) * sight -
                          rotation * Eigen::Vector3d(100, 62.5, 0)};
}

// Middles up to 72 degrees from the axis: the corners reach beyond 90.
inline Rigid wide_pose(int view) {
    return pose_aside(view, {0.15, 0.75, 1.25}, 300.0);
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

// Sets that were taken with two cameras, or one camera at two zooms.

inline constexpr double mixed_noise_px = 0.1;

inline CameraModel zoomed(double zoom, double distortion = 1.0) {
    CameraModel camera = calibration_truth();
    camera.intrinsics.fx *= zoom;
    camera.intrinsics.fy *= zoom;
    camera.distortion.k1 *= distortion;
    camera.distortion.k2 *= distortion;
    return camera;
}

// Twelve views, those of `aside` with another camera.
inline std::vector<CalibrationView> mixed(const std::vector<std::size_t>& aside,
                                          const CameraModel& other, int seed = 5) {
    auto views = synthetic_views(calibration_truth(), 12, mixed_noise_px, seed);
    for (const std::size_t i : aside)
        views[i] = synthetic_view(other, synthetic_pose(int(i)), mixed_noise_px, 500 + int(i));
    return views;
}

// Of boards whose points are not where the drawing has them.

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
