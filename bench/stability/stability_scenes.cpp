#include "bench/stability/stability_scenes.h"

#include "core/geometry/units.h"
#include "core/statistics/random.h"

namespace etalon {

CameraModel short_camera(double f_number, double focus_mm) {
    CameraModel camera;
    camera.width = 160;
    camera.height = 120;
    camera.intrinsics = {800.0, 800.0, 79.5, 59.5};
    camera.sensor = Sensor{.pixel_pitch_um = 10.0};
    camera.lens = Lens{f_number, focus_mm, 550.0, {}};
    return camera;
}

cv::Mat random_cells(int rows, int columns, std::uint64_t seed) {
    RandomStream random(seed, 23);
    cv::Mat cells(rows, columns, CV_32FC1);
    for (int j = 0; j < rows; ++j)
        for (int i = 0; i < columns; ++i)
            cells.at<float>(j, i) = random.uniform() < 0.5 ? 0.0f : 1.0f;
    return cells;
}

Distortion every_distortion() {
    return {.k1 = 0.31,
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
            .tau_y = -0.11};
}

Scene marker_scene(const CameraModel& camera, const StabilityMarker& place) {
    const double mm_per_px = place.depth_mm / camera.intrinsics.fx;
    const double side = place.side_px * mm_per_px;
    PlacedMarker marker;
    marker.grid.cells = random_cells(10, 10, 1);
    marker.grid.cell_mm = Eigen::Vector2d::Constant(side / 10.0);
    marker.grid.corner_mm = Eigen::Vector2d::Constant(-side / 2.0);
    const Eigen::Vector3d axis(std::cos(35 * rad_per_deg), std::sin(35 * rad_per_deg), 0.0);
    marker.camera_from_marker.rotation =
        Eigen::AngleAxisd(place.tilt_deg * rad_per_deg, axis) *
        Eigen::AngleAxisd(20 * rad_per_deg, Eigen::Vector3d::UnitZ());
    const Intrinsics& k = camera.intrinsics;
    const Eigen::Vector2d pixel =
        Eigen::Vector2d(camera.width - 1, camera.height - 1) / 2.0 + place.off_centre_px;
    marker.camera_from_marker.translation = {(pixel.x() - k.cx) / k.fx * place.depth_mm,
                                             (pixel.y() - k.cy) / k.fy * place.depth_mm,
                                             place.depth_mm};
    return {{marker}};
}

}  // namespace etalon
