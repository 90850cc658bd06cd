// Axis positions in, rigid transform out, with its covariance. Any chain of linear and rotary axes
// as stage/axes/axes.h describes it; the covariance is of first order (product of exponentials,
// Murray, Li and Sastry 1994, section 3.3: each error of an axis is a twist in the base frame).
//
// Pure functions, no device; some microseconds.
#pragma once

#include "stage/axes/axes.h"

namespace etalon {

// positions.size() == axes.size() and within the error maps, else ConfigError. The soft limits are
// not looked at.
Rigid base_from_carriage(std::span<const Axis> axes, std::span<const double> positions);

struct StagePose {
    Rigid base_from_carriage;
    // Left perturbation in the base frame, rotation (rad) then translation (mm) of the carriage's
    // origin: docs/conventions.md.
    Matrix6d covariance = Matrix6d::Zero();
};

// Everything that the axes declare, as independent errors: scale (about `zero`), repeatability,
// backlash, error map, direction, point. What is not declared counts as known. Scale, map,
// direction and point are the same at every pose: this is the covariance of one pose, not of
// differences.
//
// `position_uncertainty`: standard uncertainty of each position, mm or rad, as read back; empty:
// the declared noise of a single reading. Throws ConfigError like the above.
StagePose stage_pose(std::span<const Axis> axes, std::span<const double> positions,
                     std::span<const double> position_uncertainty = {});

// Standard deviation between repeated visits of a position, mm or rad: the repeatability, and the
// backlash, of which half counts, up or down, where positions are approached from either side.
// Nothing when the repeatability is not declared.
std::optional<double> approach_deviation(const Axis& axis);

}  // namespace etalon
