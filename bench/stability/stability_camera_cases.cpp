// Extreme cameras: distortion, f-numbers, focal lengths, one pixel and a hundred million.
#include <fmt/format.h>

#include "bench/stability/stability_case.h"

namespace etalon {
namespace {

struct Cases : std::vector<StabilityCase> {
    void placed(const std::string& name, const CameraModel& camera, const StabilityMarker& place) {
        push_back(agrees_with_reference(name, camera, marker_scene(camera, place)));
    }
    void refused(const std::string& name, const CameraModel& camera, const StabilityMarker& place) {
        push_back(is_refused(name, camera, marker_scene(camera, place)));
    }
};

void add_distortions(Cases& cases) {
    const auto add = [&](const std::string& name, const Distortion& distortion,
                         const StabilityMarker& place) {
        CameraModel camera = short_camera(2.8, 330.0);
        camera.intrinsics.fx = camera.intrinsics.fy = 120.0;
        camera.sensor->pixel_pitch_um = 50.0;
        camera.lens->wavelength_nm = 2750.0;
        camera.distortion = distortion;
        cases.placed(name, camera, place);
    };
    add("barrel: edges bulge outwards", {.k1 = -0.25, .k2 = 0.04},
        {.side_px = 110.0, .tilt_deg = 0.0});
    add("barrel: corners out of the image", {.k1 = -0.3, .k2 = 0.05},
        {.side_px = 170.0, .tilt_deg = 3.0});
    add("fold inside the image", {.k1 = -0.9}, {.side_px = 60.0, .off_centre_px = {30.0, 21.0}});
    add("fold crossed by the marker", {.k1 = -0.9}, {.side_px = 160.0, .tilt_deg = 4.0});
    add("pole: rational, k4 = -2", {.k4 = -2.0}, {.side_px = 90.0});
    add("pole behind a fold", {.k1 = -4.2, .k4 = -4.0}, {.side_px = 90.0});
    add("tilted sensor 0.2, -0.15 rad", {.k1 = -0.1, .tau_x = 0.2, .tau_y = -0.15}, {});
    const BenchmarkScene canon = benchmark_scene("canon-900");
    cases.push_back(agrees_with_reference("k3 = -40 (Canon)", canon.camera, canon.scene));
    CameraModel camera = short_camera(2.8, 330.0);
    camera.intrinsics.fy = 400.0;
    cases.placed("fx = 2 fy", camera, {});
    camera.intrinsics.fy = 1600.0;
    cases.placed("fy = 2 fx", camera, {});
    camera = short_camera(2.8, 330.0);
    camera.lens.reset();
    camera.intrinsics.skew = 130.0;
    camera.distortion = {.k1 = -0.25, .k2 = 0.04};
    cases.placed("skew of fx / 6, sharp", camera, {});
}

void add_lenses(Cases& cases) {
    for (const double f_number : {0.95, 22.0, 200.0}) {
        const CameraModel camera = short_camera(f_number, 330.0);
        cases.placed(fmt::format("f-number {}", f_number), camera, {});
    }
    // The same lens, 8 mm before the sensor, on pixels from 1.6 mm to 16 nm.
    for (const double focal_px : {5.0, 500000.0}) {
        CameraModel camera = short_camera(2.8, 330.0);
        camera.intrinsics.fx = camera.intrinsics.fy = focal_px;
        camera.sensor->pixel_pitch_um = 8000.0 / focal_px;
        camera.lens->wavelength_nm = 550.0 * 800.0 / focal_px;
        const double focus = focal_px > 1000.0 ? 400.01 : 330.0;
        camera.lens->focus_distance_mm = focus;
        cases.placed(fmt::format("focal length {:.0f} px", focal_px), camera,
                     {.tilt_deg = focal_px < 6 ? 3.0 : 25.0, .off_centre_px = {1.3, -0.7}});
    }
}

void add_backgrounds(Cases& cases) {
    for (const double background : {0.0, 0.5, 0.99, 1.0}) {
        const CameraModel camera = short_camera(2.8, 330.0);
        Scene scene = marker_scene(camera, {});
        scene.background = background;
        cases.push_back(
            agrees_with_reference(fmt::format("background {}", background), camera, scene));
    }
}

// 12000 x 8400 px with distortion; the marker 600 px wide.
StabilityOutcome render_megapixels(const RenderFunction& render) {
    CameraModel camera = short_camera(4.0, 500.0);
    camera.width = 12000;
    camera.height = 8400;
    camera.intrinsics = {9000.0, 9000.0, 5999.5, 4199.5};
    camera.sensor->pixel_pitch_um = 2.5;
    camera.distortion = {.k1 = -0.1, .k2 = 0.02, .p1 = 0.001};
    const Scene scene = marker_scene(camera, {.side_px = 600.0, .off_centre_px = {1500.3, -800.7}});
    const double before = peak_memory_mib() / 1024.0;
    const StabilityOutcome image =
        compare_with_reference(render(camera, scene, {}).radiance, camera, scene);
    const double after = peak_memory_mib() / 1024.0;
    return {image.passed && after < 4.0, after, 4.0,
            fmt::format("peak memory {:.2f} GiB, {:.2f} more than before; {:.3f} gray from the "
                        "reference, bound {:.3f}",
                        after, after - before, image.figure, image.bound)};
}

void add_image_sizes(Cases& cases) {
    CameraModel camera = short_camera(2.8, 330.0);
    camera.width = camera.height = 1;
    camera.intrinsics.cx = camera.intrinsics.cy = 0.0;
    cases.placed("image of 1x1 px", camera, {.side_px = 5.0, .off_centre_px = {2.4, 0.3}});
    cases.push_back({"100 megapixel image", "memory, GiB", render_megapixels});
}

// Where the marker is and how it is seen: edge-on, through the focus, near, far, tiny, huge.

void add_tilts(Cases& cases) {
    const CameraModel camera = short_camera(8.0, 300.0);
    // Off the axis, away from the tilt's, one sees more of a nearly edge-on marker.
    for (const auto& [tilt, side_px] : {std::pair{85.0, 200.0}, {89.0, 300.0}, {89.9, 400.0}})
        cases.placed(fmt::format("tilt {} deg", tilt), camera,
                     {.side_px = side_px, .tilt_deg = tilt, .off_centre_px = {17.2, -24.6}});
    cases.refused("tilt 90.1 deg: the back", camera,
                  {.tilt_deg = 90.1, .off_centre_px = {0.0, 0.0}});
    cases.refused("tilt: plane through aperture", short_camera(1.4, 300.0),
                  {.tilt_deg = 89.9, .off_centre_px = {0.0, 0.0}});
}

void add_focus(Cases& cases) {
    // f = 2.67 mm at 4 mm: nearer than 8 mm, the focal length of the lens focused at infinity.
    cases.placed("focus plane through marker", short_camera(1.4, 400.0),
                 {.side_px = 120.0, .tilt_deg = 60.0});
    cases.placed("focus plane through, wide lens", short_camera(0.95, 100.0),
                 {.side_px = 100.0, .depth_mm = 100.0, .tilt_deg = 50.0});
    cases.placed("focus on the marker", short_camera(2.8, 400.0), {.tilt_deg = 0.0});
    cases.placed("focus at infinity", short_camera(2.8, infinity), {});
    cases.placed("focus at 4 mm, z 60 mm", short_camera(2.8, 4.0),
                 {.side_px = 200.0, .depth_mm = 60.0});
    cases.refused("focus at 0 mm", short_camera(2.8, 0.0), {});
    cases.refused("focus at -100 mm", short_camera(2.8, -100.0), {});
}

// Blur radius 800 px (d / 2) / z, focused at infinity: d = 8 mm / 1.4.
void add_blurs(Cases& cases) {
    for (const double blur_px : {0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 50.0, 150.0, 500.0})
        cases.placed(fmt::format("blur radius {} px", blur_px), short_camera(1.4, infinity),
                     {.side_px = std::max(70.0, 1.5 * blur_px),
                      .depth_mm = 800.0 * (8.0 / 1.4 / 2.0) / blur_px,
                      .tilt_deg = 10.0});
}

void add_sizes(Cases& cases) {
    const CameraModel camera = short_camera(2.8, 330.0);
    for (const double side_px : {0.3, 3.0})
        cases.placed(fmt::format("tiny marker, {} px", side_px), camera, {.side_px = side_px});
    cases.placed("marker larger than the image", camera, {.side_px = 900.0});
    cases.placed("marker partly outside", camera, {.off_centre_px = {78.0, -60.0}});
    cases.placed("marker outside the image", camera, {.off_centre_px = {400.0, 300.0}});
    Scene fine = marker_scene(camera, {.side_px = 60.0});
    fine.markers[0].grid.cells = random_cells(200, 200, 2);
    fine.markers[0].grid.cell_mm /= 20.0;
    cases.push_back(agrees_with_reference("tiny cells: 200x200 on 60 px", camera, fine));
    cases.placed("far: 0.1 px at 300 m", camera, {.side_px = 0.1, .depth_mm = 300000.0});
}

// How near a marker can be, and what lies behind the lens.
void add_depths(Cases& cases) {
    const CameraModel camera = short_camera(2.8, 300.0);
    cases.placed("near: z = 5 mm", camera, {.side_px = 400.0, .depth_mm = 5.0, .tilt_deg = 5.0});
    cases.placed("near: z = 0.1 mm", camera,
                 {.side_px = 60000.0, .depth_mm = 0.1, .tilt_deg = 0.0});
    cases.refused("near: z = 0", camera, {.depth_mm = 0.0});
    cases.refused("behind the lens", camera, {.depth_mm = -400.0});
    cases.refused("corner behind the lens", camera, {.side_px = 3000.0, .tilt_deg = 60.0});
    cases.refused("marker through the aperture", camera,
                  {.side_px = 3000.0, .depth_mm = 1.0, .tilt_deg = 60.0});
}

}  // namespace

std::vector<StabilityCase> camera_cases() {
    Cases cases;
    add_distortions(cases);
    add_lenses(cases);
    add_backgrounds(cases);
    add_image_sizes(cases);
    return cases;
}

std::vector<StabilityCase> geometry_cases() {
    Cases cases;
    add_tilts(cases);
    add_focus(cases);
    add_blurs(cases);
    add_sizes(cases);
    add_depths(cases);
    return cases;
}

}  // namespace etalon
