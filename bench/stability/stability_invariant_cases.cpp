// What must not depend on how a scene is described: symmetries, limits, and energy.
#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "bench/stability/stability_case.h"

namespace etalon {
namespace {

// Everything at work, nothing symmetric.
CameraModel general_camera() {
    CameraModel camera = short_camera(1.8, 330.0);
    camera.intrinsics = {810.0, 770.0, 83.1, 55.3};
    camera.distortion = {.k1 = -0.3, .k2 = 0.1, .p1 = 0.004, .p2 = -0.003};
    return camera;
}

Radiance rendered(const RenderFunction& render, const CameraModel& camera, const Scene& scene) {
    return render(camera, scene, {}).radiance;
}

// Light of a small marker over all pixels, against its area; 2e-4 of its tail is outside. The
// tolerance of 0.1 gray allows the few pixels that it touches 0.2 gray together.
StabilityCase keeps_energy(double side_px) {
    return {fmt::format("tiny marker's energy, {} px", side_px), "area, relative",
            [=](const RenderFunction& render) {
                CameraModel camera = short_camera(2.8, 330.0);
                camera.width = camera.height = 300;
                Scene scene = marker_scene(camera, {.side_px = side_px, .tilt_deg = 0.0});
                scene.background = 0.0;
                scene.markers[0].grid.cells.setTo(0.75f);
                RenderOptions options;
                options.keep = {NeglectedEffect::tail};
                const double area = 0.75 * side_px * side_px;
                const double light = cv::sum(render(camera, scene, options).radiance)[0];
                const double error = light / area - 1.0;
                const double bound = 1e-3 + 0.2 / 255.0 / area;
                return StabilityOutcome{std::abs(error) <= bound, std::abs(error), bound,
                                        fmt::format("relative error {:.2e}", error)};
            }};
}

// Squarely seen and undistorted, a marker moves by whole pixels without a change.
StabilityOutcome move_by_pixels(const RenderFunction& render) {
    const CameraModel camera = short_camera(1.8, 330.0);
    StabilityMarker place{.side_px = 40.0, .tilt_deg = 0.0};
    const Radiance here = rendered(render, camera, marker_scene(camera, place));
    place.off_centre_px += Eigen::Vector2d(7.0, -5.0);
    const Radiance there = rendered(render, camera, marker_scene(camera, place));
    const cv::Rect part(20, 20, 110, 80);
    return differ_by(here(part), there(part + cv::Point(7, -5)));
}

StabilityOutcome mirror(const RenderFunction& render) {
    const CameraModel camera = general_camera();
    const Scene scene = marker_scene(camera, {});
    CameraModel mirrored = camera;
    mirrored.intrinsics.cx = camera.width - 1 - camera.intrinsics.cx;
    mirrored.distortion.p2 = -camera.distortion.p2;
    Scene other = scene;
    PlacedMarker& marker = other.markers[0];
    Rigid& pose = marker.camera_from_marker;
    pose.rotation.y() *= -1.0;
    pose.rotation.z() *= -1.0;
    pose.translation.x() *= -1.0;
    marker.grid.cells = cv::Mat();  // not in the other scene's memory
    cv::flip(scene.markers[0].grid.cells, marker.grid.cells, 1);
    cv::Mat back;
    cv::flip(rendered(render, mirrored, other), back, 1);
    return differ_by(rendered(render, camera, scene), back);
}

// Clockwise in the image, (x, y) -> (-y, x). The tangential pair (p2, p1) turns as a vector.
StabilityOutcome quarter_turn(const RenderFunction& render) {
    const CameraModel camera = general_camera();
    const Scene scene = marker_scene(camera, {});
    CameraModel turned = camera;
    std::swap(turned.width, turned.height);
    const Intrinsics& k = camera.intrinsics;
    turned.intrinsics = {k.fy, k.fx, camera.height - 1 - k.cy, k.cx};
    turned.sensor->pixel_pitch_um *= k.fx / k.fy;
    turned.distortion.p1 = camera.distortion.p2;
    turned.distortion.p2 = -camera.distortion.p1;
    Scene other = scene;
    const Rigid quarter{Eigen::Quaterniond(std::sqrt(0.5), 0.0, 0.0, std::sqrt(0.5)), {0, 0, 0}};
    other.markers[0].camera_from_marker = quarter * scene.markers[0].camera_from_marker;
    cv::Mat back;
    cv::rotate(rendered(render, turned, other), back, cv::ROTATE_90_COUNTERCLOCKWISE);
    return differ_by(rendered(render, camera, scene), back);
}

// The blur vanishes without a jump when the focus is drawn onto the marker.
StabilityOutcome approach_focus(const RenderFunction& render) {
    const StabilityMarker place{.tilt_deg = 0.0};
    StabilityOutcome worst{true, 0.0, 0.2, "largest difference from the image in focus"};
    const CameraModel sharp = short_camera(1.8, place.depth_mm);
    const Radiance in_focus = rendered(render, sharp, marker_scene(sharp, place));
    for (const double away : {1e-15, 1e-12, 1e-9, 1e-6, 1e-5, -1e-5, -1e-9}) {
        const CameraModel camera = short_camera(1.8, place.depth_mm * (1.0 + away));
        const StabilityOutcome step =
            differ_by(in_focus, rendered(render, camera, marker_scene(camera, place)));
        if (step.figure >= worst.figure)
            worst = step;
    }
    return worst;
}

StabilityOutcome approach_infinity(const RenderFunction& render) {
    const CameraModel far = short_camera(2.8, 1e12), infinite = short_camera(2.8, infinity);
    const Scene scene = marker_scene(far, {});
    return differ_by(rendered(render, far, scene), rendered(render, infinite, scene));
}

// Without diffraction (a wavelength of 1 fm) a closed aperture is a pinhole.
StabilityOutcome approach_pinhole(const RenderFunction& render) {
    CameraModel closed = short_camera(1e5, 330.0), pinhole = closed;
    closed.lens->wavelength_nm = 1e-6;
    pinhole.lens.reset();
    const Scene scene = marker_scene(closed, {});
    return differ_by(rendered(render, closed, scene), rendered(render, pinhole, scene));
}

Scene in_four_pieces(const Scene& scene, int column, int row) {
    const PlacedMarker& whole = scene.markers[0];
    Scene pieces = scene;
    pieces.markers.clear();
    const int columns = whole.grid.columns(), rows = whole.grid.rows();
    for (const auto& part :
         {cv::Rect(0, 0, column, row), cv::Rect(column, 0, columns - column, row),
          cv::Rect(0, row, column, rows - row),
          cv::Rect(column, row, columns - column, rows - row)}) {
        PlacedMarker piece = whole;
        piece.grid.cells = whole.grid.cells(part).clone();
        piece.grid.corner_mm += whole.grid.cell_mm.cwiseProduct(Eigen::Vector2d(part.x, part.y));
        pieces.markers.push_back(piece);
    }
    return pieces;
}

StabilityOutcome divide(const RenderFunction& render) {
    const CameraModel camera = general_camera();
    const Scene scene = marker_scene(camera, {});
    return differ_by(rendered(render, camera, scene),
                     rendered(render, camera, in_four_pieces(scene, 3, 7)));
}

}  // namespace

std::vector<StabilityCase> invariant_cases() {
    const std::string alike = "same image, gray";
    return {keeps_energy(0.3),
            keeps_energy(5.0),
            {"moved by whole pixels", alike, move_by_pixels},
            {"mirrored", alike, mirror},
            {"turned by 90 degrees", alike, quarter_turn},
            {"focus drawn onto the marker", alike, approach_focus},
            {"focus from 1e9 m to infinity", alike, approach_infinity},
            {"f-number 1e5 and a pinhole", alike, approach_pinhole},
            {"one marker as four pieces", alike, divide}};
}

}  // namespace etalon
