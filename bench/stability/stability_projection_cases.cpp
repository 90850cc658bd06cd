// Projection and undistortion, there and back over the whole image and beyond the border of the
// valid region.
#include <fmt/format.h>

#include "bench/benchmark_scenes.h"
#include "bench/stability/stability_case.h"
#include "bench/stability/stability_scenes.h"
#include "calib/camera/projector.h"

namespace etalon {
namespace {

// Pixels to rays and back; relative to the distance from the principal point plus a pixel.
StabilityOutcome there_and_back(const CameraModel& camera) {
    constexpr int columns = 41, rows = 31;
    constexpr double bound = 1e-12;
    const Projector projector(camera);
    const Eigen::Vector2d centre(camera.intrinsics.cx, camera.intrinsics.cy);
    double worst = 0.0;
    int valid = 0;
    for (int n = 0; n < columns * rows; ++n) {
        const Eigen::Vector2d pixel((camera.width - 1.0) * (n % columns) / (columns - 1),
                                    (camera.height - 1.0) * (n / columns) / (rows - 1));
        const auto ray = projector.unproject(pixel);
        if (!ray)
            continue;
        ++valid;
        const auto back = projector.project(ray->homogeneous());
        const double off = back ? (*back - pixel).norm() : infinity;
        worst = std::max(worst, off / ((pixel - centre).norm() + 1.0));
    }
    return {valid > 0 && worst <= bound, worst, bound,
            fmt::format("{} of {} pixels have a ray", valid, columns * rows)};
}

StabilityCase round_trip(const std::string& name, const CameraModel& camera) {
    return {"projection: " + name, "round trip, relative",
            [=](const RenderFunction&) { return there_and_back(camera); }};
}

CameraModel wide_camera(const Distortion& distortion) {
    CameraModel camera;
    camera.width = 640;
    camera.height = 480;
    camera.intrinsics = {500.0, 520.0, 318.3, 243.9};
    camera.distortion = distortion;
    return camera;
}

CameraModel focal_length(double focal_px) {
    CameraModel camera = wide_camera({.k1 = -0.1});
    camera.intrinsics.fx = camera.intrinsics.fy = focal_px;
    return camera;
}

// Points that no camera sees, and numbers that are none: nothing comes back.
StabilityOutcome no_ray_for_nonsense(const RenderFunction&) {
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

}  // namespace

std::vector<StabilityCase> projection_cases() {
    return {round_trip("webcam", benchmark_scene("webcam-500").camera),
            round_trip("k3 = -40", benchmark_scene("canon-500").camera),
            round_trip("fold", wide_camera({.k1 = -1.5})),
            round_trip("pole", wide_camera({.k4 = -2.0})),
            round_trip("pole and fold", wide_camera({.k1 = -4.2, .k4 = -4.0})),
            round_trip("all 14 numbers", wide_camera(every_distortion())),
            round_trip("focal length 5 px", focal_length(5.0)),
            round_trip("focal length 5e5 px", focal_length(500000.0)),
            {"projection: nan and infinity", "number accepted", no_ray_for_nonsense}};
}

}  // namespace etalon
