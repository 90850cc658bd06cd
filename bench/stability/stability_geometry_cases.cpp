// Where the marker is and how it is seen: edge-on, through the focus, near, far, tiny, huge.
#include <fmt/format.h>

#include "bench/stability/stability_case.h"
#include "bench/stability/stability_scenes.h"

namespace etalon {
namespace {

StabilityCase placed(const std::string& name, const CameraModel& camera,
                     const StabilityMarker& place) {
    return agrees_with_reference(name, camera, marker_scene(camera, place));
}
StabilityCase refused(const std::string& name, const CameraModel& camera,
                      const StabilityMarker& place) {
    return is_refused(name, camera, marker_scene(camera, place));
}

void add_tilts(std::vector<StabilityCase>& cases) {
    const CameraModel camera = short_camera(8.0, 300.0);
    // Off the axis, away from the tilt's, one sees more of a nearly edge-on marker.
    for (const auto& [tilt, side_px] : {std::pair{85.0, 200.0}, {89.0, 300.0}, {89.9, 400.0}})
        cases.push_back(
            placed(fmt::format("tilt {} deg", tilt), camera,
                   {.side_px = side_px, .tilt_deg = tilt, .off_centre_px = {17.2, -24.6}}));
    cases.push_back(refused("tilt 90.1 deg: the back", camera,
                            {.tilt_deg = 90.1, .off_centre_px = {0.0, 0.0}}));
    cases.push_back(refused("tilt: plane through aperture", short_camera(1.4, 300.0),
                            {.tilt_deg = 89.9, .off_centre_px = {0.0, 0.0}}));
}

void add_focus(std::vector<StabilityCase>& cases) {
    cases.push_back(placed("focus plane through marker", short_camera(1.4, 400.0),
                           {.side_px = 120.0, .tilt_deg = 60.0}));
    cases.push_back(placed("focus plane through, wide lens", short_camera(0.95, 100.0),
                           {.side_px = 100.0, .depth_mm = 100.0, .tilt_deg = 50.0}));
    cases.push_back(placed("focus on the marker", short_camera(2.8, 400.0), {.tilt_deg = 0.0}));
    cases.push_back(placed("focus at infinity", short_camera(2.8, infinity), {}));
    // f = 2.67 mm: nearer than the focal length of the same lens focused at infinity (8 mm).
    cases.push_back(placed("focus at 4 mm, z 60 mm", short_camera(2.8, 4.0),
                           {.side_px = 200.0, .depth_mm = 60.0}));
    for (const double focus_mm : {0.0, -100.0}) {
        CameraModel camera = short_camera(2.8, focus_mm);
        cases.push_back(refused(fmt::format("focus at {} mm", focus_mm), camera, {}));
    }
}

// Blur radius 800 px (d / 2) / z, focused at infinity: d = 8 mm / 1.4.
void add_blurs(std::vector<StabilityCase>& cases) {
    for (const double blur_px : {0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 50.0, 150.0, 500.0})
        cases.push_back(placed(fmt::format("blur radius {} px", blur_px),
                               short_camera(1.4, infinity),
                               {.side_px = std::max(70.0, 1.5 * blur_px),
                                .depth_mm = 800.0 * (8.0 / 1.4 / 2.0) / blur_px,
                                .tilt_deg = 10.0}));
}

void add_sizes(std::vector<StabilityCase>& cases) {
    const CameraModel camera = short_camera(2.8, 330.0);
    for (const double side_px : {0.3, 3.0})
        cases.push_back(
            placed(fmt::format("tiny marker, {} px", side_px), camera, {.side_px = side_px}));
    cases.push_back(placed("marker larger than the image", camera, {.side_px = 900.0}));
    cases.push_back(placed("marker partly outside", camera, {.off_centre_px = {78.0, -60.0}}));
    cases.push_back(placed("marker outside the image", camera, {.off_centre_px = {400.0, 300.0}}));
    Scene fine = marker_scene(camera, {.side_px = 60.0});
    fine.markers[0].grid.cells = random_cells(200, 200, 2);
    fine.markers[0].grid.cell_mm /= 20.0;
    cases.push_back(agrees_with_reference("tiny cells: 200x200 on 60 px", camera, fine));
    cases.push_back(placed("far: 0.1 px at 300 m", camera, {.side_px = 0.1, .depth_mm = 300000.0}));
}

// How near a marker can be, and what lies behind the lens.
void add_depths(std::vector<StabilityCase>& cases) {
    const CameraModel camera = short_camera(2.8, 300.0);
    cases.push_back(
        placed("near: z = 5 mm", camera, {.side_px = 400.0, .depth_mm = 5.0, .tilt_deg = 5.0}));
    cases.push_back(
        placed("near: z = 0.1 mm", camera, {.side_px = 60000.0, .depth_mm = 0.1, .tilt_deg = 0.0}));
    cases.push_back(refused("near: z = 0", camera, {.depth_mm = 0.0}));
    cases.push_back(refused("behind the lens", camera, {.depth_mm = -400.0}));
    cases.push_back(
        refused("corner behind the lens", camera, {.side_px = 3000.0, .tilt_deg = 60.0}));
    cases.push_back(refused("marker through the aperture", camera,
                            {.side_px = 3000.0, .depth_mm = 1.0, .tilt_deg = 60.0}));
}

}  // namespace

std::vector<StabilityCase> geometry_cases() {
    std::vector<StabilityCase> cases;
    add_tilts(cases);
    add_focus(cases);
    add_blurs(cases);
    add_sizes(cases);
    add_depths(cases);
    return cases;
}

}  // namespace etalon
