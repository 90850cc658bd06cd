#include "bench/benchmark_scenes.h"

#include <fmt/format.h>

#include "calib/camera/projector.h"
#include "core/errors.h"
#include "core/text.h"
#include "core/units.h"
#include "sim/marker/marker.h"

namespace etalon {
namespace {

// The table gives the working f-number N_w; the camera file's is N = f/d = N_w f/v.
void add_lens(CameraModel& camera, double pitch_um, double working_f_number, double focus_mm) {
    const double v = camera.intrinsics.fx * pitch_um * 1e-3;
    const double f = 1.0 / (1.0 / focus_mm + 1.0 / v);
    camera.sensor = Sensor{.pixel_pitch_um = pitch_um};
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

Rigid tag_pose(const CameraModel& camera, double z_mm, const Eigen::Vector2d& pixel) {
    const Eigen::Vector3d axis(std::cos(35 * rad_per_deg), std::sin(35 * rad_per_deg), 0.0);
    const Eigen::AngleAxisd tilt(30 * rad_per_deg, axis);
    const Eigen::AngleAxisd turn(20 * rad_per_deg, Eigen::Vector3d::UnitZ());
    const Eigen::Vector2d x = Projector(camera).unproject(pixel).value();
    return {Eigen::Quaterniond(tilt * turn), z_mm * x.homogeneous()};
}

BenchmarkScene make_scene(const std::string& name, const CameraModel& camera, double grid_mm,
                          double z_mm, const Eigen::Vector2d& pixel) {
    // The size in a tag's name is that of its black square: 0.8 of the grid.
    const std::string spec = fmt::format("apriltag:36h11:0@{}mm", exact(0.8 * grid_mm));
    BenchmarkScene result{name, camera, {}};
    result.scene.markers = {
        {parse_marker(spec, "benchmark scene " + name).grid, tag_pose(camera, z_mm, pixel)}};
    return result;
}

}  // namespace

std::vector<BenchmarkScene> benchmark_scenes() {
    std::vector<BenchmarkScene> scenes;
    for (const auto& [kind, focus_mm] : {std::pair{"webcam", 150.0}, {"sharp", 1000.0}})
        for (const int z_mm : {500, 1000, 1500}) {
            const Eigen::Vector2d pixel =
                z_mm == 500 ? Eigen::Vector2d(420, 170) : Eigen::Vector2d(480, 120);
            scenes.push_back(
                make_scene(fmt::format("{}-{}", kind, z_mm), webcam(focus_mm), 50, z_mm, pixel));
        }
    scenes.push_back(make_scene("canon-500", canon(), 200, 500, {1450, 900}));
    scenes.push_back(make_scene("canon-900", canon(), 200, 900, {1700, 750}));
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
