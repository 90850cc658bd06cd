#include "stage/axes/kinematics.h"

#include <fmt/format.h>

#include <cmath>

namespace etalon {
namespace {

// What the map says at a position; without a map there is no error.
ErrorMapPoint map_at(const Axis& axis, double position) {
    if (!axis.errors)
        return {position};
    const auto point = axis.errors->at(position);
    if (!point)
        throw ConfigError({"stage axes", 0, axis.name},
                          fmt::format("its error map says nothing at position {} {}", position,
                                      axis.kind == Axis::Kind::linear ? "mm" : "rad"));
    return *point;
}

// How far the axis truly is from where it sits as mounted.
double displacement(const Axis& axis, double position) {
    return position - axis.zero + map_at(axis, position).error;
}

Rigid motion(const Axis& axis, double distance) {
    if (axis.kind == Axis::Kind::linear)
        return {Eigen::Quaterniond::Identity(), axis.direction * distance};
    const Eigen::Quaterniond turn = rotation_from_vector(axis.direction * distance);
    return {turn, axis.point_mm - turn * axis.point_mm};
}

double squared(double value) {
    return value * value;
}

// Half the backlash up or down unless every position is approached from the same side.
double backlash_variance(const Axis& axis) {
    const double sides = axis.approach == 0 ? squared(axis.backlash / 2.0) : 0.0;
    return sides + squared(axis.backlash_uncertainty.value_or(0.0));
}

double displacement_variance(const Axis& axis, double position, double position_uncertainty) {
    return squared(position_uncertainty) + squared(map_at(axis, position).uncertainty) +
           squared(axis.scale_uncertainty.value_or(0.0) * (position - axis.zero)) +
           squared(axis.repeatability.value_or(0.0)) + backlash_variance(axis);
}

// The errors of one axis as perturbations of what the whole chain carries: `variance` is that of
// how far the axis is, which is at `distance` in the frame base_from_mount.
Matrix6d error_covariance(const Axis& axis, double distance, double variance,
                          const Rigid& base_from_mount, const Rigid& base_from_carriage) {
    const bool linear = axis.kind == Axis::Kind::linear;
    const Eigen::Matrix3d rotation = base_from_mount.rotation.toRotationMatrix();
    const Eigen::Vector3d lever =  // from the axis' point to the carriage's origin
        base_from_carriage.translation - base_from_mount * axis.point_mm;
    const auto shift = [&](const Eigen::Vector3d& in_mount) -> Vector6d {
        return (Vector6d() << Eigen::Vector3d::Zero(), rotation * in_mount).finished();
    };
    const auto turn = [&](const Eigen::Vector3d& in_mount) -> Vector6d {
        const Eigen::Vector3d in_base = rotation * in_mount;
        return (Vector6d() << in_base, in_base.cross(lever)).finished();
    };
    const auto outer = [](const Vector6d& p) -> Matrix6d { return p * p.transpose(); };

    Matrix6d sum = variance * outer(linear ? shift(axis.direction) : turn(axis.direction));
    const double lean = squared(axis.direction_uncertainty.value_or(0.0));
    const double point = squared(axis.point_uncertainty.value_or(0.0));
    const Eigen::Quaterniond turned = rotation_from_vector(axis.direction * distance);
    const Eigen::Vector3d first = axis.direction.unitOrthogonal();
    for (const Eigen::Vector3d& across : {first, Eigen::Vector3d(axis.direction.cross(first))}) {
        // The direction leans by 1 rad: a linear axis also goes `across`, a rotary one is turned
        // about `across` before its own turn and back afterwards. Both perpendiculars are summed.
        const Eigen::Vector3d back = across - turned * across;
        sum += lean * outer(linear ? shift(across * distance) : turn(back)) +
               point * outer(linear ? Vector6d::Zero() : shift(back));
    }
    return sum;
}

}  // namespace

Rigid base_from_carriage(std::span<const Axis> axes, std::span<const double> positions) {
    require_same_count(axes.size(), positions.size(), {"stage axes"});
    Rigid base_from_moved;
    for (std::size_t i = 0; i < axes.size(); ++i)
        base_from_moved = base_from_moved * axes[i].previous_from_mount *
                          motion(axes[i], displacement(axes[i], positions[i]));
    return base_from_moved;
}

StagePose stage_pose(std::span<const Axis> axes, std::span<const double> positions,
                     std::span<const double> position_uncertainty) {
    StagePose pose{base_from_carriage(axes, positions)};
    if (!position_uncertainty.empty())
        require_same_count(axes.size(), position_uncertainty.size(), {"stage axes"});
    Rigid base_from_moved;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const double distance = displacement(axes[i], positions[i]);
        const double uncertainty = position_uncertainty.empty() ? axes[i].read_noise.value_or(0.0)
                                                                : position_uncertainty[i];
        const Rigid base_from_mount = base_from_moved * axes[i].previous_from_mount;
        pose.covariance += error_covariance(
            axes[i], distance, displacement_variance(axes[i], positions[i], uncertainty),
            base_from_mount, pose.base_from_carriage);
        base_from_moved = base_from_mount * motion(axes[i], distance);
    }
    return pose;
}

std::optional<double> approach_deviation(const Axis& axis) {
    if (!axis.repeatability)
        return std::nullopt;
    return std::sqrt(squared(*axis.repeatability) + backlash_variance(axis));
}

}  // namespace etalon
