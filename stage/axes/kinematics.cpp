#include "stage/axes/kinematics.h"

#include <fmt/format.h>

#include <cmath>

namespace etalon {
namespace {

void require_same_count(std::size_t axes, std::size_t numbers) {
    if (axes != numbers)
        throw ConfigError({"stage axes"}, fmt::format("{} positions for {} axes", numbers, axes));
}

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

// The errors of one axis as perturbations of what the whole chain carries.
class AxisErrorSum {
public:
    // The axis is at `distance` in the frame base_from_mount; the chain's end is
    // base_from_carriage.
    AxisErrorSum(const Axis& axis, double distance, const Rigid& base_from_mount,
                 const Rigid& base_from_carriage)
        : axis_(axis),
          distance_(distance),
          rotation_(base_from_mount.rotation.toRotationMatrix()),
          lever_(base_from_carriage.translation - base_from_mount * axis.point_mm) {}

    Matrix6d covariance(double variance) const {
        Matrix6d sum = variance * outer(along());
        const double lean = squared(axis_.direction_uncertainty.value_or(0.0));
        const double shift = squared(axis_.point_uncertainty.value_or(0.0));
        for (const Eigen::Vector3d& across : perpendiculars())
            sum += lean * outer(leaning(across)) + shift * outer(shifted(across));
        return sum;
    }

private:
    static Matrix6d outer(const Vector6d& perturbation) {
        return perturbation * perturbation.transpose();
    }
    // A turn about the axis' point moves the carriage's origin as well.
    Vector6d turn(const Eigen::Vector3d& in_mount) const {
        const Eigen::Vector3d in_base = rotation_ * in_mount;
        return (Vector6d() << in_base, in_base.cross(lever_)).finished();
    }
    Vector6d shift_by(const Eigen::Vector3d& in_mount) const {
        return (Vector6d() << Eigen::Vector3d::Zero(), rotation_ * in_mount).finished();
    }
    Vector6d along() const {
        return axis_.kind == Axis::Kind::linear ? shift_by(axis_.direction) : turn(axis_.direction);
    }
    // The direction leans by 1 rad. A linear axis then goes `across` as well; a rotary one is
    // turned about `across` before its own turn and back afterwards. (Which of the two
    // perpendiculars is meant does not matter: both are summed.)
    Vector6d leaning(const Eigen::Vector3d& across) const {
        if (axis_.kind == Axis::Kind::linear)
            return shift_by(across * distance_);
        return turn(across - turned(across));
    }
    Vector6d shifted(const Eigen::Vector3d& across) const {
        if (axis_.kind == Axis::Kind::linear)
            return Vector6d::Zero();
        return shift_by(across - turned(across));
    }
    Eigen::Vector3d turned(const Eigen::Vector3d& vector) const {
        return rotation_from_vector(axis_.direction * distance_) * vector;
    }
    std::array<Eigen::Vector3d, 2> perpendiculars() const {
        const Eigen::Vector3d first = axis_.direction.unitOrthogonal();
        return {first, axis_.direction.cross(first)};
    }

    const Axis& axis_;
    double distance_;
    Eigen::Matrix3d rotation_;
    Eigen::Vector3d lever_;  // from the axis' point to the carriage's origin, in the base frame
};

}  // namespace

Rigid base_from_carriage(std::span<const Axis> axes, std::span<const double> positions) {
    require_same_count(axes.size(), positions.size());
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
        require_same_count(axes.size(), position_uncertainty.size());
    Rigid base_from_moved;
    for (std::size_t i = 0; i < axes.size(); ++i) {
        const double distance = displacement(axes[i], positions[i]);
        const double uncertainty = position_uncertainty.empty() ? axes[i].read_noise.value_or(0.0)
                                                                : position_uncertainty[i];
        const Rigid base_from_mount = base_from_moved * axes[i].previous_from_mount;
        const AxisErrorSum errors(axes[i], distance, base_from_mount, pose.base_from_carriage);
        pose.covariance +=
            errors.covariance(displacement_variance(axes[i], positions[i], uncertainty));
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
