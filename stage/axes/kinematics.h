// Axis positions in, rigid transform and covariance out, for any chain of axes (axes.h). The
// covariance is of first order: each error of an axis is a twist in the base frame (Murray, Li and
// Sastry 1994, section 3.3). Pure functions, no device; some microseconds.
#pragma once

#include "stage/axes/axes.h"

namespace etalon {

// One position per axis, within the error maps, else ConfigError. Soft limits are not looked at.
Rigid base_from_carriage(std::span<const Axis> axes, std::span<const double> positions);

struct StagePose {
    Rigid base_from_carriage;
    // Left perturbation in the base frame, rotation (rad) then translation (mm) of the carriage's
    // origin: docs/conventions.md.
    Matrix6d covariance = Matrix6d::Zero();
};

// Of all that the axes declare, as independent errors: scale (about `zero`), repeatability,
// backlash, error map, direction, point. Undeclared ones are 0. Scale, map, direction and point are
// common to all poses: this is the covariance of one pose, not of differences.
//
// `position_uncertainty`: standard, of each position read back, mm or rad; empty: the declared
// noise of a reading. Throws ConfigError like the above.
StagePose stage_pose(std::span<const Axis> axes, std::span<const double> positions,
                     std::span<const double> position_uncertainty = {});

// Standard deviation between repeated visits of a position, mm or rad: the repeatability, and half
// the backlash where positions are approached from either side. Nothing without a repeatability.
std::optional<double> approach_deviation(const Axis& axis);

}  // namespace etalon
