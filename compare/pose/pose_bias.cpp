#include "compare/pose/pose_bias.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double settled_px = 0.002;

void require_corners(const ImagePoints& corners, std::size_t count) {
    if (corners.size() != count)
        throw NumericalError(fmt::format("pose bias: the detector gave {} corners for {} points",
                                         corners.size(), count));
}

// Registered poses with the detector's bias subtracted, and their indices among those given.
struct CorrectedPoses {
    std::vector<RegistrationPose> poses;
    std::vector<std::size_t> used;
};

// Poses whose bias is not known are rendered where `registration` has them, and left out where that
// render is not detected. Without a registration they stay as they are.
CorrectedPoses bias_corrected(const Projector& projector, const ObjectPoints& points,
                              std::span<const RegistrationPose> poses,
                              std::span<const ImagePoints> known_bias,
                              const Registration* registration,
                              const RenderAndDetect& render_and_detect) {
    CorrectedPoses corrected;
    for (std::size_t i = 0; i < poses.size(); ++i) {
        RegistrationPose pose = poses[i];
        if (!known_bias.empty() && !known_bias[i].empty()) {
            pose.pixels = differences(pose.pixels, known_bias[i]);
        } else if (registration) {
            const Rigid predicted = registration->camera_from_marker(pose.base_from_carriage);
            const std::optional<ImagePoints> rendered = render_and_detect(predicted);
            if (!rendered)
                continue;
            pose.pixels = differences(
                pose.pixels, differences(*rendered, projected(projector, points, predicted)));
        }
        corrected.poses.push_back(std::move(pose));
        corrected.used.push_back(i);
    }
    return corrected;
}

double largest_move_px(const Projector& projector, const ObjectPoints& points,
                       std::span<const RegistrationPose> poses, const Registration& before,
                       const Registration& after) {
    double largest = 0.0;
    for (const RegistrationPose& pose : poses) {
        const ImagePoints from =
            projected(projector, points, before.camera_from_marker(pose.base_from_carriage));
        const ImagePoints to =
            projected(projector, points, after.camera_from_marker(pose.base_from_carriage));
        for (std::size_t k = 0; k < from.size(); ++k)
            largest = std::max(largest, (to[k] - from[k]).norm());
    }
    return largest;
}

std::optional<PoseEstimate> estimate_near(const Projector& projector, const ObjectPoints& points,
                                          const ImagePoints& corners, const Rigid& predicted) {
    if (corners.empty())
        return std::nullopt;
    require_corners(corners, points.size());
    return estimate_pose_near(projector, points, corners, predicted);
}

}  // namespace

ImagePoints projected(const Projector& projector, const ObjectPoints& points_mm,
                      const Rigid& camera_from_marker) {
    ImagePoints pixels;
    for (const Eigen::Vector3d& point : points_mm) {
        const auto pixel = projector.project(camera_from_marker * point);
        if (!pixel)
            throw NumericalError("pose bias: the marker lies outside the camera's valid region");
        pixels.push_back(*pixel);
    }
    return pixels;
}

ImagePoints differences(const ImagePoints& corners, const ImagePoints& others) {
    require_corners(others, corners.size());
    ImagePoints result;
    for (std::size_t k = 0; k < corners.size(); ++k)
        result.push_back(corners[k] - others[k]);
    return result;
}

PoseError pose_error(const Rigid& estimated, const Rigid& truth) {
    return {estimated.translation - truth.translation,
            rotation_vector(truth.rotation.conjugate() * estimated.rotation)};
}

BiasCorrectedRegistration register_bias_corrected(const Projector& projector,
                                                  const ObjectPoints& points_mm,
                                                  std::span<const RegistrationPose> poses,
                                                  const Rigid& nominal_carriage_from_marker,
                                                  const RenderAndDetect& render_and_detect,
                                                  std::span<const ImagePoints> known_bias,
                                                  int max_rounds) {
    if (!known_bias.empty() && known_bias.size() != poses.size())
        throw NumericalError("pose bias: the known biases are not of these poses");
    BiasCorrectedRegistration result;
    const auto registered = [&](const Registration* from) {
        const CorrectedPoses corrected =
            bias_corrected(projector, points_mm, poses, known_bias, from, render_and_detect);
        result.used = corrected.used;
        result.corrected_px.clear();
        for (const RegistrationPose& pose : corrected.poses)
            result.corrected_px.push_back(pose.pixels);
        return register_stage(projector, points_mm, corrected.poses, nominal_carriage_from_marker);
    };
    result.registration = registered(nullptr);
    if (!known_bias.empty() && std::ranges::none_of(known_bias, &ImagePoints::empty))
        return result;
    do {
        const Registration next = registered(&result.registration);
        result.last_change_px =
            largest_move_px(projector, points_mm, poses, result.registration, next);
        result.changes_px.push_back(result.last_change_px);
        result.registration = next;
        ++result.rounds;
    } while (result.rounds < max_rounds && result.last_change_px > settled_px);
    return result;
}

PoseBias pose_bias(const Projector& projector, const ObjectPoints& points_mm,
                   const Rigid& predicted, const ImagePoints& photo_corners,
                   const ImagePoints& render_corners) {
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
