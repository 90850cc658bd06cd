// Corner errors and detection rates of the STag detector on exact renders: the webcam and the poses
// of the published comparison (docs/stag.md), and near poses with larger markers.
#pragma once

#include <tbb/parallel_for.h>

#include <numbers>

#include "compare/make_detector.h"
#include "sim/render/renderer.h"
#include "sim/scene/pose_sampling.h"
#include "tests/calib/cameras.h"

namespace etalon::test {

// The sensor: 5100 electrons full scale, 10 electrons read noise; 1.3 % of noise at white.
inline CameraModel noisy_webcam(double focus_mm) {
    return study_webcam(focus_mm, 20.0, 10.0);
}

// A webcam with strong barrel distortion.
inline CameraModel barrel_webcam() {
    CameraModel camera = noisy_webcam(1000.0);
    camera.intrinsics = {538.55, 536.2, 317.3, 241.8};
    camera.distortion = {.k1 = -0.286, .k2 = 0.057, .k3 = 0.112};
    camera.sensor->pixel_pitch_um = 8.3;
    camera.lens->f_number = 2.8;
    return camera;
}

struct PoseRange {
    double nearest_mm, farthest_mm;
    double tilt_rad;  // largest; or of roll and of pitch
    bool roll_and_pitch;
};

// Of the published comparison: R = Rz(yaw) Ry(pitch) Rx(roll), roll and pitch up to 45 degrees.
inline constexpr PoseRange study_range{500.0, 1500.0, std::numbers::pi / 4.0, true};
// Tilts up to 60 degrees in any direction, sides of 63 to 160 px.
inline constexpr PoseRange near_range{250.0, 650.0, std::numbers::pi / 3.0, false};

inline Eigen::Quaterniond rotation_of(const PoseRange& range, const std::vector<double>& u) {
    using Eigen::AngleAxisd;
    using Vector = Eigen::Vector3d;
    const double turn = (2.0 * u[5] - 1.0) * std::numbers::pi;
    const AngleAxisd yaw(turn, Vector::UnitZ());
    if (range.roll_and_pitch)
        return Eigen::Quaterniond(yaw *
                                  AngleAxisd((2.0 * u[4] - 1.0) * range.tilt_rad, Vector::UnitY()) *
                                  AngleAxisd((2.0 * u[3] - 1.0) * range.tilt_rad, Vector::UnitX()));
    const double towards = 2.0 * std::numbers::pi * u[4];
    return Eigen::Quaterniond(
        AngleAxisd(u[3] * range.tilt_rad, Vector(std::cos(towards), std::sin(towards), 0.0)) * yaw);
}

// The whole marker with its border must be in the image; nothing else is left out.
inline std::optional<Rigid> study_pose(const Projector& projector, const CameraModel& camera,
                                       const Marker& marker, const PoseRange& range,
                                       std::uint64_t index) {
    const std::vector<double> u = HaltonSequence(6, 7).point(index + 1);
    const double z = range.nearest_mm + (range.farthest_mm - range.nearest_mm) * u[2];
    const Rigid pose{rotation_of(range, u),
                     {(u[0] - 0.5) * z * camera.width / camera.intrinsics.fx,
                      (u[1] - 0.5) * z * camera.height / camera.intrinsics.fy, z}};
    for (const Eigen::Vector3d& corner : marker.points_mm) {
        const auto pixel = projector.project(pose * Eigen::Vector3d(1.25 * corner));
        if (!pixel || !(pixel->array() > 0.0).all() || pixel->x() > camera.width - 1 ||
            pixel->y() > camera.height - 1)
            return std::nullopt;
    }
    return pose;
}

struct CornerErrors {
    int poses = 0, detected = 0;
    std::vector<double> errors_px;  // of markers of 60 px a side and more
    std::vector<double> small_errors_px;
    double inward_px = 0.0;  // mean towards the centre, of those of 60 px
};

struct OneView {
    bool detected = false;
    double side_px = 0.0;
    std::array<double, 4> errors_px{}, inward_px{};
};

inline OneView look(const Renderer& renderer, const Marker& marker, const Rigid& pose,
                    std::uint32_t number) {
    const CameraModel& camera = renderer.camera();
    const auto radiance = renderer.render({{{marker.grid, pose}}, 1.0}).radiance;
    const CodeImage photo = SensorModel(camera).expose(0.85 * radiance, NoiseKey{5, number});
    const auto found = make_detector("stag", marker, "study")->detect(photo).corners;
    OneView view;
    view.detected = found.has_value();
    const std::vector<Eigen::Vector2d> truth =
        corners_at(Projector(camera), marker.points_mm, pose);
    const Eigen::Vector2d centre = (truth[0] + truth[1] + truth[2] + truth[3]) / 4.0;
    for (std::size_t i = 0; i < 4; ++i) {
        view.side_px += (truth[(i + 1) % 4] - truth[i]).norm() / 4.0;
        if (!found)
            continue;
        const Eigen::Vector2d error = found->pixels[i] - truth[i];
        view.errors_px[i] = error.norm();
        view.inward_px[i] = error.dot((centre - truth[i]).normalized());
    }
    return view;
}

inline CornerErrors corner_errors(const CameraModel& camera, const Marker& marker,
                                  const PoseRange& range, std::size_t count) {
    const Renderer renderer(camera);
    const Projector projector(camera);
    std::vector<Rigid> poses;
    for (std::uint64_t i = 0; poses.size() < count; ++i)
        if (const auto pose = study_pose(projector, camera, marker, range, i))
            poses.push_back(*pose);
    std::vector<OneView> views(count);
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
        views[i] = look(renderer, marker, poses[i], static_cast<std::uint32_t>(i));
    });
    CornerErrors result;
    for (const OneView& view : views) {
        ++result.poses;
        result.detected += view.detected;
        if (!view.detected)
            continue;
        auto& errors = view.side_px >= 60.0 ? result.errors_px : result.small_errors_px;
        errors.insert(errors.end(), view.errors_px.begin(), view.errors_px.end());
        if (view.side_px >= 60.0)
            for (const double inward : view.inward_px)
                result.inward_px += inward;
    }
    if (!result.errors_px.empty())
        result.inward_px /= static_cast<double>(result.errors_px.size());
    return result;
}

// The p-th part of the sorted errors; `errors` must not be empty.
inline double quantile(std::vector<double> errors, double p) {
    const auto at =
        errors.begin() + static_cast<std::ptrdiff_t>(p * static_cast<double>(errors.size() - 1));
    std::nth_element(errors.begin(), at, errors.end());
    return *at;
}

}  // namespace etalon::test
