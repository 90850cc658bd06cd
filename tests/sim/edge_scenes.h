// A straight edge before a small camera: the scene in which sampling errors are largest.
#pragma once

#include "sim/render/renderer.h"

namespace etalon::test {

inline constexpr double gray = 1.0 / 255.0;

// 96 x 72 px, f = 400 px, focused at 150 mm: blur radius at z is 400 d/2 |1/z - 1/150|, d = 1.71
// mm.
inline CameraModel small_camera(PointSpread spread) {
    CameraModel camera;
    camera.width = 96;
    camera.height = 72;
    camera.intrinsics = {400.0, 400.0, 47.0, 35.0};
    camera.sensor = Sensor{.pixel_pitch_um = 6.0};
    camera.lens = Lens{1.4, 150.0, 600.0, spread};
    return camera;
}

// Black left of x = edge_mm, white right of it, far beyond the image on every side.
inline Scene half_plane(double edge_mm, double z_mm) {
    PlacedMarker plane;
    plane.grid.cells = (cv::Mat_<float>(1, 2) << 0.0f, 1.0f);
    plane.grid.cell_mm = {2000.0, 4000.0};
    plane.grid.corner_mm = {edge_mm - 2000.0, -2000.0};
    plane.camera_from_marker.translation = {0.0, 0.0, z_mm};
    return {{plane}};
}

inline double largest_difference(const cv::Mat& a, const cv::Mat& b) {
    return cv::norm(a, b, cv::NORM_INF);
}

}  // namespace etalon::test
