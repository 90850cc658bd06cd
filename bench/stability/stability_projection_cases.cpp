// Projection and undistortion, there and back; of wide lenses where their formulas are stiff: on
// the axis, at and beyond 90 degrees, at their fold, near and far, opposite the axis.
#include <fmt/format.h>

#include "bench/stability/stability_case.h"
#include "calib/camera/projector.h"

namespace etalon {
namespace {

constexpr double pi = std::numbers::pi;

CameraModel wide_lens(const LensProjection& projection, double focal_px,
                      const Distortion& distortion = {}) {
    return camera_without_lens(640, 480, {focal_px, 0.99 * focal_px, 318.3, 243.9}, distortion,
                               projection);
}

// Of 220 degrees, bent one way here and another there.
LensProjection uneven_spline() {
    constexpr int columns = 15, rows = 13;
    std::vector<double> control;
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            control.push_back(0.031 * std::sin(1.7 * column + row));
            control.push_back(0.029 * std::cos(0.9 * column - 2.0 * row));
        }
    return splined_projection(3, columns, rows, 220.0, control);
}

struct WideLens {
    const char* name;
    CameraModel camera;
};

// Of some 200 degrees along the width, with whatever distortion belongs to the kind.
std::vector<WideLens> wide_lenses() {
    using enum Projection;
    const Distortion kannala_brandt{.k1 = 0.031, .k2 = -0.014, .k3 = 0.0021, .k7 = -2e-4};
    const Distortion radtan{.k1 = -0.11, .k2 = 0.07, .p1 = 0.0012, .p2 = -0.0007};
    return {{"equidistant, k1-k3 k7", wide_lens({equidistant}, 181.0, kannala_brandt)},
            {"stereographic", wide_lens({stereographic}, 134.0)},
            {"field of view", wide_lens({field_of_view, 0.93}, 190.0)},
            {"unified, k1 k2 p1 p2", wide_lens({unified, 1.31}, 430.0, radtan)},
            {"extended unified", wide_lens({extended_unified, 1.09, 0.63}, 190.0)},
            {"double sphere", wide_lens({double_sphere, -0.17, 0.59}, 155.0)},
            {"polynomial", wide_lens(polynomial_projection(-0.31, 0.02, -0.011, 0.003), 170.0)},
            {"CAHVORE, still pupil",
             wide_lens(cahvor_projection(0.013, -0.021, 1e-3, 0.021, -0.001, 0.6), 100.0)},
            {"splined stereographic", wide_lens(uneven_spline(), 134.0)}};
}

Eigen::Vector3d ray_at(double angle) {
    return {0.8 * std::sin(angle), 0.6 * std::sin(angle), std::cos(angle)};
}

// Pixels of a grid over the image to rays and back; relative to the distance from the principal
// point plus a pixel. What sees more than a plane must have rays from behind.
StabilityOutcome there_and_back(const CameraModel& camera) {
    constexpr int columns = 41, rows = 31;
    constexpr double bound = 1e-12;
    const Projector projector(camera);
    const Eigen::Vector2d centre(camera.intrinsics.cx, camera.intrinsics.cy);
    double worst = 0.0, widest = 1.0;
    int valid = 0;
    for (int n = 0; n < columns * rows; ++n) {
        const Eigen::Vector2d pixel((camera.width - 1.0) * (n % columns) / (columns - 1),
                                    (camera.height - 1.0) * (n / columns) / (rows - 1));
        const auto ray = projector.ray(pixel);
        if (!ray)
            continue;
        ++valid;
        widest = std::min(widest, ray->z());
        const auto back = projector.project(*ray);
        const double off = back ? (*back - pixel).norm() : infinity;
        worst = std::max(worst, off / ((pixel - centre).norm() + 1.0));
    }
    const bool is_wide = !camera.projection.is_flat();
    return {valid > 0 && worst <= bound && (widest < 0.0 || !is_wide), worst, bound,
            fmt::format("{} of {} pixels have a ray, out to {:.1f} degrees", valid, columns * rows,
                        std::acos(widest) * 180.0 / pi)};
}

// The ray that comes back, in radians, from the axis on to beyond a right angle.
StabilityOutcome angles_come_back(const CameraModel& camera) {
    const Projector projector(camera);
    double worst = 0.0;
    for (const double degrees : {0.0, 1e-12, 1e-6, 1e-3, 45.0, 89.99, 90.0, 90.01, 95.0}) {
        const Eigen::Vector3d ray = ray_at(degrees * pi / 180.0);
        const auto pixel = projector.project(ray);
        const auto back = pixel ? projector.ray(*pixel) : std::nullopt;
        worst = std::max(worst, back ? back->cross(ray).norm() : infinity);
    }
    return at_most(1e-13, worst, "from 0 to 95 degrees");
}

// The same pixel of points from a micrometre to 400 km away.
StabilityOutcome distance_does_not_matter(const CameraModel& camera) {
    const Projector projector(camera);
    double worst = 0.0;
    for (const double angle : {0.0, 1e-5, 0.7, 1.6})
        for (const double distance_mm : {1e-3, 4e8}) {
            const auto near = projector.project(ray_at(angle));
            const auto there = projector.project(distance_mm * ray_at(angle));
            worst = std::max(
                worst, near && there ? (*near - *there).norm() / (near->norm() + 1.0) : infinity);
        }
    return at_most(1e-12, worst, "points 1 um and 400 km away");
}

// What has no image: behind along the axis, no direction, no number, beyond a fold.
StabilityOutcome nonsense_has_no_image() {
    int accepted = 0, seen = 0;
    for (const WideLens& lens : wide_lenses()) {
        const Projector projector(lens.camera);
        for (const Eigen::Vector3d& point :
             {Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(0, 0, -4e8), Eigen::Vector3d(0, 0, 0),
              Eigen::Vector3d(std::numeric_limits<double>::quiet_NaN(), 0, 1),
              Eigen::Vector3d(1, infinity, 1)})
            accepted += projector.project(point).has_value();
        accepted += projector.ray({infinity, 0.0}).has_value();
    }
    // theta (1 - 0.2 theta^2) grows to sqrt(1 / 0.6) and not beyond.
    const Projector folding(wide_lens({Projection::equidistant}, 181.0, {.k1 = -0.2}));
    const double fold = std::sqrt(1.0 / 0.6);
    for (const double beyond : {1e-9, 0.1, 1.0, 1.8})
        accepted += folding.project(ray_at(fold + beyond)).has_value();
    for (const double before : {1e-9, 0.1, 1.0})
        seen += folding.project(ray_at(fold - before)).has_value();
    return {accepted == 0 && seen == 3, double(accepted + 3 - seen), 0.0,
            "points without an image, pixels without a ray, and a fold"};
}

// Coefficients of zero against the ideal lens, in long double.
StabilityOutcome zeros_are_the_ideal_lens() {
    const Projector projector(wide_lens({Projection::equidistant}, 181.0));
    double worst = 0.0;
    for (const double angle : {1e-9, 1e-4, 0.9, 1.6, 3.1}) {
        const auto pixel = projector.project(ray_at(angle));
        const long double x = 181.0L * 0.8L * static_cast<long double>(angle) + 318.3L;
        worst = std::max(worst,
                         pixel ? std::abs(static_cast<double>(pixel->x() - x)) / 318.3 : infinity);
    }
    return at_most(1e-13, worst, "equidistant, x = 0.8 f theta + cx");
}

// Projection and undistortion of lenses that see a plane.

StabilityCase round_trip(const std::string& name, const CameraModel& camera) {
    return without_render("projection: " + name, "round trip, relative",
                          [=] { return there_and_back(camera); });
}

CameraModel wide_camera(const Distortion& distortion) {
    return camera_without_lens(640, 480, {500.0, 520.0, 318.3, 243.9}, distortion);
}

CameraModel focal_length(double focal_px) {
    return camera_without_lens(640, 480, {focal_px, focal_px, 318.3, 243.9}, {.k1 = -0.1});
}

// Points that no camera sees, and numbers that are none: nothing comes back.
StabilityOutcome no_ray_for_nonsense() {
    const Projector projector(wide_camera({.k1 = -0.2}));
    int accepted = 0;
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), infinity, -infinity})
        for (int i = 0; i < 3; ++i) {
            Eigen::Vector3d point(10.0, 20.0, 500.0);
            point[i] = bad;
            const bool vanishes = i == 2 && bad > 0.0;  // a point at infinity on the axis
            accepted += projector.project(point).has_value() && !vanishes;
            if (i < 2)
                accepted += projector.unproject(point.head<2>()).has_value();
        }
    accepted += projector.project({1.0, 2.0, 0.0}).has_value();
    accepted += projector.project({1.0, 2.0, -500.0}).has_value();
    return {accepted == 0, double(accepted), 0.0, "points and pixels without a meaning"};
}

// Renders through lenses that see more than a plane: the scenes of the bench, and what is hard of
// them: much blur far from the axis, focus inside the marker, the valid region's end, very near.

constexpr double deg = pi / 180.0;

// 640 x 480 px of 30 um, 190 degrees along the width.
CameraModel fisheye(double f_number, double focus_mm, const Distortion& distortion) {
    CameraModel camera = camera_without_lens(640, 480, {181.0, 179.0, 318.3, 243.9}, distortion,
                                             {Projection::equidistant});
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

std::vector<StabilityCase> wide_lens_cases() {
    std::vector<StabilityCase> cases;
    for (const WideLens& lens : wide_lenses()) {
        const auto add = [&](const char* what, const char* expectation,
                             StabilityOutcome (*check)(const CameraModel&)) {
            cases.push_back(without_render(fmt::format("{}{}", what, lens.name), expectation,
                                           [=, camera = lens.camera] { return check(camera); }));
        };
        add("wide: ", "round trip, relative", there_and_back);
        add("angles: ", "round trip, rad", angles_come_back);
        add("near, far: ", "same pixel, relative", distance_does_not_matter);
    }
    cases.push_back(without_render("wide: no image", "number accepted", nonsense_has_no_image));
    cases.push_back(
        without_render("wide: zeros are ideal", "closed form, relative", zeros_are_the_ideal_lens));
    return cases;
}

std::vector<StabilityCase> projection_cases() {
    return {round_trip("webcam", benchmark_scene("webcam-500").camera),
            round_trip("k3 = -40", benchmark_scene("canon-500").camera),
            round_trip("fold", wide_camera({.k1 = -1.5})),
            round_trip("pole", wide_camera({.k4 = -2.0})),
            round_trip("pole and fold", wide_camera({.k1 = -4.2, .k4 = -4.0})),
            round_trip("all 14 numbers", wide_camera(every_distortion())),
            round_trip("focal length 5 px", focal_length(5.0)),
            round_trip("focal length 5e5 px", focal_length(500000.0)),
            without_render("projection: nan and infinity", "number accepted", no_ray_for_nonsense)};
}

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
