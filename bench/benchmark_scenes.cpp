#include "bench/benchmark_scenes.h"

#include <fmt/format.h>

#include "calib/camera/projector.h"
#include "core/file/text.h"
#include "core/geometry/units.h"
#include "sim/marker/marker.h"

namespace etalon {

CameraModel camera_without_lens(int width, int height, const Intrinsics& intrinsics,
                                const Distortion& distortion, const LensProjection& projection) {
    CameraModel camera;
    camera.width = width;
    camera.height = height;
    camera.intrinsics = intrinsics;
    camera.distortion = distortion;
    camera.projection = projection;
    return camera;
}

namespace {

// With the working f-number N_w; the camera file's is N = f/d = N_w f/v.
CameraModel with_lens(CameraModel camera, double pitch_um, double working_f_number,
                      double focus_mm) {
    camera.sensor = Sensor{.pixel_pitch_um = pitch_um};
    const double v = image_distance_mm(camera);
    const double f = 1.0 / (1.0 / focus_mm + 1.0 / v);
    camera.lens = Lens{working_f_number * f / v, focus_mm, 650.0, {}};
    return camera;
}

CameraModel webcam(double focus_mm) {
    return with_lens(camera_without_lens(640, 480, {538.55, 538.55, 319.5, 239.5},
                                         {.k1 = -0.286, .k2 = 0.057, .k3 = 0.112}),
                     8.3, 2.8, focus_mm);
}

CameraModel canon() {
    constexpr double focal_px = 26.49 / 0.0057;
    return with_lens(camera_without_lens(2816, 1880, {focal_px, focal_px, 1407.5, 939.5},
                                         {.k1 = -0.125, .k2 = 3.855, .k3 = -40.371}),
                     5.7, 4.5, 700.0);
}

// Of 190 degrees along the width.
CameraModel wide(const LensProjection& projection, double focal_px, const Distortion& distortion) {
    return camera_without_lens(1280, 960, {focal_px, focal_px, 640.7, 478.2}, distortion,
                               projection);
}

CameraModel fisheye() {
    return with_lens(wide({Projection::equidistant}, 385.0,
                          {.k1 = -0.012, .k2 = 0.0031, .k3 = -0.0009, .k7 = 0.00007}),
                     12.0, 1.4, 300.0);
}

CameraModel omnidirectional() {
    return with_lens(
        wide({Projection::unified, 1.31}, 850.0, {.k1 = -0.11, .k2 = 0.07, .p1 = 0.0012}), 6.0, 2.0,
        500.0);
}

Eigen::Quaterniond tag_rotation() {
    const Eigen::Vector3d axis(std::cos(35 * rad_per_deg), std::sin(35 * rad_per_deg), 0.0);
    const Eigen::AngleAxisd tilt(30 * rad_per_deg, axis);
    const Eigen::AngleAxisd turn(20 * rad_per_deg, Eigen::Vector3d::UnitZ());
    return Eigen::Quaterniond(tilt * turn);
}

Rigid tag_pose(const CameraModel& camera, double z_mm, const Eigen::Vector2d& pixel) {
    const Eigen::Vector2d x = Projector(camera).unproject(pixel).value();
    return {tag_rotation(), z_mm * x.homogeneous()};
}

// Seen at an angle to the axis, from this distance, tilted to the line of sight.
Rigid tag_beside(double angle_deg, double azimuth_deg, double distance_mm) {
    const double angle = angle_deg * rad_per_deg, azimuth = azimuth_deg * rad_per_deg;
    const Eigen::Vector3d sight(std::sin(angle) * std::cos(azimuth),
                                std::sin(angle) * std::sin(azimuth), std::cos(angle));
    return {rotation_between(Eigen::Vector3d::UnitZ(), sight) * tag_rotation(),
            distance_mm * sight};
}

}  // namespace

std::vector<BenchmarkScene> benchmark_scenes() {
    std::vector<BenchmarkScene> scenes;
    const auto add = [&](const std::string& name, const CameraModel& camera, double grid_mm,
                         const Rigid& pose) {
        // The size in a tag's name is that of its black square: 0.8 of the grid.
        const std::string spec = fmt::format("apriltag:36h11:0@{}mm", exact(0.8 * grid_mm));
        const CellGrid grid = parse_marker(spec, "benchmark scene " + name).grid;
        scenes.push_back({name, camera, {{{grid, pose}}}});
    };
    const auto add_seen = [&](const std::string& kind, const CameraModel& camera, double grid_mm,
                              int z_mm, const Eigen::Vector2d& pixel) {
        add(fmt::format("{}-{}", kind, z_mm), camera, grid_mm, tag_pose(camera, z_mm, pixel));
    };
    for (const auto& [kind, focus_mm] : {std::pair{"webcam", 150.0}, {"sharp", 1000.0}}) {
        add_seen(kind, webcam(focus_mm), 50, 500, {420, 170});
        add_seen(kind, webcam(focus_mm), 50, 1000, {480, 120});
        add_seen(kind, webcam(focus_mm), 50, 1500, {480, 120});
    }
    add_seen("focus", webcam(150), 50, 152, {300, 260});
    add_seen("canon", canon(), 200, 500, {1450, 900});
    add_seen("canon", canon(), 200, 900, {1700, 750});
    add("fisheye-10", fisheye(), 50, tag_beside(10, 25, 150));
    add("fisheye-60", fisheye(), 50, tag_beside(60, 140, 120));
    add("fisheye-95", fisheye(), 50, tag_beside(95, 5, 100));
    add("fisheye-near", fisheye(), 200, tag_beside(40, 70, 110));
    add("omni-50", omnidirectional(), 100, tag_beside(50, -160, 200));
    add("sphere-88", wide({Projection::double_sphere, -0.17, 0.59}, 320.0, {}), 50,
        tag_beside(88, -10, 120));
    return scenes;
}

BenchmarkScene benchmark_scene(const std::string& name) {
    std::string names;
    for (const BenchmarkScene& scene : benchmark_scenes()) {
        if (scene.name == name)
            return scene;
        names += " " + scene.name;
    }
    throw ConfigError({"benchmark scene"},
                      fmt::format("no scene is named {}; there are{}", name, names));
}

}  // namespace etalon
