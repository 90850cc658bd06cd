// Cameras that several tests of calib/ use: those of the published renderer comparison, and hard
// ones.
#pragma once

#include "calib/camera/projector.h"
#include "core/geometry/rigid.h"

namespace etalon::test {

inline CameraModel camera_with(int width, int height, Intrinsics intrinsics,
                               Distortion distortion = {}) {
    CameraModel camera;
    camera.width = width;
    camera.height = height;
    camera.intrinsics = intrinsics;
    camera.distortion = distortion;
    return camera;
}

// Where the camera sees a marker's points.
inline std::vector<Eigen::Vector2d> corners_at(const Projector& projector,
                                               const std::vector<Eigen::Vector3d>& points,
                                               const Rigid& camera_from_marker) {
    std::vector<Eigen::Vector2d> corners;
    for (const Eigen::Vector3d& point : points)
        corners.push_back(projector.project(camera_from_marker * point).value());
    return corners;
}

inline CameraModel camera_with_lens(int width, int height, Intrinsics intrinsics,
                                    Distortion distortion, double pixel_pitch_um,
                                    const Lens& lens) {
    CameraModel camera = camera_with(width, height, intrinsics, distortion);
    camera.sensor = Sensor{.pixel_pitch_um = pixel_pitch_um};
    camera.lens = lens;
    return camera;
}

inline CameraModel webcam() {
    return camera_with(640, 480, {538.55, 538.55, 319.5, 239.5},
                       {.k1 = -0.286, .k2 = 0.057, .k3 = 0.112});
}

// k3 = -40: folds just outside the image's corners.
inline CameraModel canon() {
    const double f = 26.49 / 0.0057;
    return camera_with(2816, 1880, {f, f, 1407.5, 939.5},
                       {.k1 = -0.125, .k2 = 3.855, .k3 = -40.371});
}

// Every coefficient at work, nothing symmetric.
inline CameraModel all_fourteen() {
    return camera_with(700, 500, {611.0, 587.0, 361.0, 239.0},
                       {.k1 = 0.31,
                        .k2 = -0.12,
                        .p1 = 0.0021,
                        .p2 = -0.0034,
                        .k3 = 0.05,
                        .k4 = 0.41,
                        .k5 = -0.08,
                        .k6 = 0.03,
                        .s1 = 0.0031,
                        .s2 = -0.0012,
                        .s3 = -0.0023,
                        .s4 = 0.0017,
                        .tau_x = 0.07,
                        .tau_y = -0.11});
}

// 160 degrees across the diagonal: the Pade approximant of r_d = atan(r), an equidistant fisheye as
// far as the rational model can be one.
inline CameraModel wide_angle() {
    return camera_with(
        1000, 800, {300.0, 290.0, 503.0, 391.0},
        {.k1 = 735.0 / 945, .k2 = 64.0 / 945, .k4 = 1050.0 / 945, .k5 = 225.0 / 945});
}

}  // namespace etalon::test
