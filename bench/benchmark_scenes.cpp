#include "bench/benchmark_scenes.h"

#include <fmt/format.h>

#include "calib/camera/projector.h"
#include "core/file/text.h"
#include "core/geometry/units.h"
#include "core/program/errors.h"
#include "sim/marker/marker.h"

namespace etalon {
namespace {

// The table gives the working f-number N_w; the camera file's is N = f/d = N_w f/v.
void add_lens(CameraModel& camera, double pitch_um, double working_f_number, double focus_mm) {
    camera.sensor = Sensor{.pixel_pitch_um = pitch_um};
    const double v = image_distance_mm(camera);
    const double f = 1.0 / (1.0 / focus_mm + 1.0 / v);
    camera.lens = Lens{working_f_number * f / v, focus_mm, 650.0, {}};
}

CameraModel webcam(double focus_mm) {
    CameraModel camera;
    camera.width = 640;
    camera.height = 480;
    camera.intrinsics = {538.55, 538.55, 319.5, 239.5};
    camera.distortion = {.k1 = -0.286, .k2 = 0.057, .k3 = 0.112};
    add_lens(camera, 8.3, 2.8, focus_mm);
    return camera;
}

CameraModel canon() {
    CameraModel camera;
    camera.width = 2816;
    camera.height = 1880;
    camera.intrinsics = {26.49 / 0.0057, 26.49 / 0.0057, 1407.5, 939.5};
    camera.distortion = {.k1 = -0.125, .k2 = 3.855, .k3 = -40.371};
    add_lens(camera, 5.7, 4.5, 700.0);
    return camera;
}

// Of 190 degrees along the width.
CameraModel wide(const LensProjection& projection, double focal_px, const Distortion& distortion) {
    CameraModel camera;
    camera.width = 1280;
    camera.height = 960;
    camera.projection = projection;
    camera.intrinsics = {focal_px, focal_px, 640.7, 478.2};
    camera.distortion = distortion;
    return camera;
}

CameraModel fisheye() {
    CameraModel camera = wide({Projection::equidistant}, 385.0,
                              {.k1 = -0.012, .k2 = 0.0031, .k3 = -0.0009, .k7 = 0.00007});
    add_lens(camera, 12.0, 1.4, 300.0);
    return camera;
}

CameraModel omnidirectional() {
    CameraModel camera =
        wide({Projection::unified, 1.31}, 850.0, {.k1 = -0.11, .k2 = 0.07, .p1 = 0.0012});
    add_lens(camera, 6.0, 2.0, 500.0);
    return camera;
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

BenchmarkScene make_scene(const std::string& name, const CameraModel& camera, double grid_mm,
                          const Rigid& pose) {
    // The size in a tag's name is that of its black square: 0.8 of the grid.
    const std::string spec = fmt::format("apriltag:36h11:0@{}mm", exact(0.8 * grid_mm));
    BenchmarkScene result{name, camera, {}};
    result.scene.markers = {{parse_marker(spec, "benchmark scene " + name).grid, pose}};
    return result;
}

}  // namespace

std::vector<BenchmarkScene> benchmark_scenes() {
    std::vector<BenchmarkScene> scenes;
    for (const auto& [kind, focus_mm] : {std::pair{"webcam", 150.0}, {"sharp", 1000.0}})
        for (const int z_mm : {500, 1000, 1500}) {
            const Eigen::Vector2d pixel =
                z_mm == 500 ? Eigen::Vector2d(420, 170) : Eigen::Vector2d(480, 120);
            const CameraModel camera = webcam(focus_mm);
            scenes.push_back(make_scene(fmt::format("{}-{}", kind, z_mm), camera, 50,
                                        tag_pose(camera, z_mm, pixel)));
        }
    scenes.push_back(make_scene("focus-152", webcam(150), 50,
                                tag_pose(webcam(150), 152, Eigen::Vector2d(300, 260))));
    for (const auto& [z_mm, pixel] :
         {std::pair{500, Eigen::Vector2d(1450, 900)}, {900, Eigen::Vector2d(1700, 750)}})
        scenes.push_back(make_scene(fmt::format("canon-{}", z_mm), canon(), 200,
                                    tag_pose(canon(), z_mm, pixel)));
    scenes.push_back(make_scene("fisheye-10", fisheye(), 50, tag_beside(10, 25, 150)));
    scenes.push_back(make_scene("fisheye-60", fisheye(), 50, tag_beside(60, 140, 120)));
    scenes.push_back(make_scene("fisheye-95", fisheye(), 50, tag_beside(95, 5, 100)));
    scenes.push_back(make_scene("fisheye-near", fisheye(), 200, tag_beside(40, 70, 110)));
    scenes.push_back(make_scene("omni-50", omnidirectional(), 100, tag_beside(50, -160, 200)));
    scenes.push_back(make_scene("sphere-88",
                                wide({Projection::double_sphere, -0.17, 0.59}, 320, {}), 50,
                                tag_beside(88, -10, 120)));
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
