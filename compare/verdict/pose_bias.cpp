#include "compare/verdict/pose_bias.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/errors.h"

namespace etalon {
namespace {

using Pixels = std::vector<Eigen::Vector2d>;
using Points = std::vector<Eigen::Vector3d>;

constexpr double settled_px = 0.002;

Pixels projections(const Projector& projector, const Points& points,
                   const Rigid& camera_from_marker) {
    Pixels pixels;
    for (const Eigen::Vector3d& point : points) {
        const auto pixel = projector.project(camera_from_marker * point);
        if (!pixel)
            throw NumericalError(
                "pose bias: the marker is predicted outside the camera's valid region");
        pixels.push_back(*pixel);
    }
    return pixels;
}

void require_corners(const Pixels& corners, std::size_t count) {
    if (corners.size() != count)
        throw NumericalError(fmt::format("pose bias: the detector gave {} corners for {} points",
                                         corners.size(), count));
}

// The given poses with the detector's bias at `registration` subtracted; poses whose render is not
// detected are left out. `used` gets the indices of those that remain.
std::vector<RegistrationPose> bias_corrected(const Projector& projector, const Points& points,
                                             std::span<const RegistrationPose> poses,
                                             const Registration& registration,
                                             const RenderAndDetect& render_and_detect,
                                             std::vector<std::size_t>& used) {
    std::vector<RegistrationPose> corrected;
    used.clear();
    for (std::size_t i = 0; i < poses.size(); ++i) {
        const Rigid predicted = registration.camera_from_marker(poses[i].base_from_carriage);
        const Pixels truth = projections(projector, points, predicted);
        const std::optional<Pixels> rendered = render_and_detect(predicted);
        if (!rendered)
            continue;
        require_corners(*rendered, points.size());
        RegistrationPose pose = poses[i];
        for (std::size_t k = 0; k < truth.size(); ++k)
            pose.pixels[k] -= (*rendered)[k] - truth[k];
        corrected.push_back(std::move(pose));
        used.push_back(i);
    }
    return corrected;
}

double largest_move_px(const Projector& projector, const Points& points,
                       std::span<const RegistrationPose> poses, const Registration& before,
                       const Registration& after) {
    double largest = 0.0;
    for (const RegistrationPose& pose : poses) {
        const Pixels from =
            projections(projector, points, before.camera_from_marker(pose.base_from_carriage));
        const Pixels to =
            projections(projector, points, after.camera_from_marker(pose.base_from_carriage));
        for (std::size_t k = 0; k < from.size(); ++k)
            largest = std::max(largest, (to[k] - from[k]).norm());
    }
    return largest;
}

std::optional<PoseEstimate> estimate_near(const Projector& projector, const Points& points,
                                          const Pixels& corners, const Rigid& predicted) {
    if (corners.empty())
        return std::nullopt;
    require_corners(corners, points.size());
    return estimate_pose_near(projector, points, corners, predicted);
}

}  // namespace

std::vector<Eigen::Vector2d> differences(const std::vector<Eigen::Vector2d>& corners,
                                         const std::vector<Eigen::Vector2d>& others) {
    require_corners(others, corners.size());
    std::vector<Eigen::Vector2d> result;
    for (std::size_t k = 0; k < corners.size(); ++k)
        result.push_back(corners[k] - others[k]);
    return result;
}

PoseError pose_error(const Rigid& estimated, const Rigid& truth) {
    return {estimated.translation - truth.translation,
            rotation_vector(truth.rotation.conjugate() * estimated.rotation)};
}

BiasCorrectedRegistration register_bias_corrected(const Projector& projector,
                                                  const std::vector<Eigen::Vector3d>& points_mm,
                                                  std::span<const RegistrationPose> poses,
                                                  const Rigid& nominal_carriage_from_marker,
                                                  const RenderAndDetect& render_and_detect,
                                                  int max_rounds) {
    BiasCorrectedRegistration result;
    result.registration = register_stage(projector, points_mm, poses, nominal_carriage_from_marker);
    result.last_change_px = std::numeric_limits<double>::max();
    while (result.rounds < max_rounds && result.last_change_px > settled_px) {
        const std::vector<RegistrationPose> corrected = bias_corrected(
            projector, points_mm, poses, result.registration, render_and_detect, result.used);
        const Registration next =
            register_stage(projector, points_mm, corrected, nominal_carriage_from_marker);
        result.last_change_px =
            largest_move_px(projector, points_mm, poses, result.registration, next);
        result.changes_px.push_back(result.last_change_px);
        result.registration = next;
        result.corrected_px.clear();
        for (const RegistrationPose& pose : corrected)
            result.corrected_px.push_back(pose.pixels);
        ++result.rounds;
    }
    return result;
}

PoseBias pose_bias(const Projector& projector, const std::vector<Eigen::Vector3d>& points_mm,
                   const Rigid& predicted, const std::vector<Eigen::Vector2d>& photo_corners,
                   const std::vector<Eigen::Vector2d>& render_corners) {
    PoseBias bias;
    bias.predicted = predicted;
    bias.photo = estimate_near(projector, points_mm, photo_corners, predicted);
    bias.render = estimate_near(projector, points_mm, render_corners, predicted);
    if (bias.render)
        bias.b1 = pose_error(bias.render->camera_from_marker, predicted);
    if (bias.photo)
        bias.b2 = pose_error(bias.photo->camera_from_marker, predicted);
    if (bias.photo && bias.render) {
        bias.difference_px = differences(photo_corners, render_corners);
        bias.b3 = pose_error(bias.photo->camera_from_marker, bias.render->camera_from_marker);
    }
    return bias;
}

}  // namespace etalon
