// Renders through lenses that see more than a plane: the scenes of the bench, and what is hard of
// them: much blur far from the axis, focus inside the marker, the valid region's end, very near.
#include <numbers>

#include "bench/benchmark_scenes.h"
#include "bench/stability/stability_case.h"
#include "bench/stability/stability_scenes.h"

namespace etalon {
namespace {

constexpr double deg = std::numbers::pi / 180.0;

// 640 x 480 px of 30 um, 190 degrees along the width.
CameraModel fisheye(double f_number, double focus_mm, const Distortion& distortion) {
    CameraModel camera;
    camera.width = 640;
    camera.height = 480;
    camera.projection = {Projection::equidistant};
    camera.intrinsics = {181.0, 179.0, 318.3, 243.9};
    camera.distortion = distortion;
    camera.sensor = Sensor{.pixel_pitch_um = 30.0};
    camera.lens = Lens{f_number, focus_mm, 550.0, {}};
    return camera;
}

// 9 x 7 cells, seen at an angle to the axis and tilted to the line of sight.
Scene beside(double angle_deg, double distance_mm, double cell_mm, double tilt_deg) {
    PlacedMarker marker{
        {random_cells(7, 9, 5), {-4.5 * cell_mm, -3.5 * cell_mm}, {cell_mm, cell_mm}}, {}};
    const double angle = angle_deg * deg;
    const Eigen::Vector3d sight(-0.8 * std::sin(angle), 0.6 * std::sin(angle), std::cos(angle));
    marker.camera_from_marker = {
        rotation_between(Eigen::Vector3d::UnitZ(), sight) *
            rotation_from_vector(tilt_deg * deg * Eigen::Vector3d(0.6, -0.8, 0.0)),
        distance_mm * sight};
    return {{marker}, 0.4};
}

}  // namespace

std::vector<StabilityCase> wide_render_cases() {
    std::vector<StabilityCase> cases;
    for (const char* name :
         {"fisheye-10", "fisheye-60", "fisheye-95", "fisheye-near", "omni-50", "sphere-88"}) {
        const BenchmarkScene bench = benchmark_scene(name);
        cases.push_back(agrees_with_reference(name, bench.camera, bench.scene));
    }
    const Distortion bent{.k1 = 0.031, .k2 = -0.014, .k3 = 0.0021, .k7 = -2e-4};
    const auto placed = [&](const char* name, double f_number, double focus_mm,
                            const Scene& scene) {
        cases.push_back(agrees_with_reference(name, fisheye(f_number, focus_mm, bent), scene));
    };
    placed("fisheye: 12 px of blur at 85 deg", 1.4, 20.0, beside(85, 70, 9, 20));
    placed("fisheye: focus within, 70 deg", 0.7, 60.0, beside(70, 60, 6, 60));
    placed("fisheye: edge-on, 95 deg", 1.4, 100.0, beside(95, 90, 8, 82));
    placed("fisheye: 3 px tag at 89.99 deg", 2.0, 300.0, beside(89.99, 2000, 4, 30));
    placed("fisheye: 140 deg, 12 mm away", 8.0, 100.0, beside(30, 12, 7, 10));
    // The map folds at 1.29 rad, 74 degrees, within the image: the marker is cut there.
    cases.push_back(agrees_with_reference(
        "fisheye: cut by its fold", fisheye(1.4, 100.0, {.k1 = -0.2}), beside(70, 100, 6, 20)));
    cases.push_back(is_refused("fisheye: 170 deg wide, 2 mm away", fisheye(8.0, 100.0, bent),
                               beside(30, 2, 9, 10)));
    return cases;
}

}  // namespace etalon
