// What kind of motion a plan's poses make together, from the stage's transforms alone: how many
// directions of (X, Y) a registration leaves free. Such a direction is a motion of the base frame
// that commutes with every relative motion S_i S_j^-1 of the carriage (H. H. Chen, "A screw motion
// approach to uniqueness analysis of head-eye geometry", CVPR 1991).
//
// A plan that moves less than its stage can is degenerate: part of X and Y, or of a camera's errors
// in depth, stays undetermined. It is named, and not registered.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/geometry/rigid.h"

namespace etalon {

// From least to most: a plan whose kind comes before that of its stage moves less than it can.
enum class MotionKind {
    none,            // all poses are the same: 6 free directions
    collinear,       // shifts along one line: 4
    planar_shifts,   // shifts in one plane: 3
    shifts,          // shifts in space: 3
    one_axis,        // turns about one fixed axis, with or without shifts along it: 2
    planar_motion,   // turns about parallel axes and shifts across them: 1
    parallel_turns,  // turns about parallel axes and shifts in space: 1
    all_turns,       // turns about axes that are not parallel: 0
};

struct StageMotion {
    MotionKind kind = MotionKind::none;
    int freedoms = 6;        // of X and Y
    int distinct_poses = 0;  // counted up to 4
    std::string words;       // "shifts along one line, base x"
    // The poses as exact motions of this kind, without what counts as noise. Otherwise an axis at
    // rest whose reading trembles by a microradian would place X and Y, by tens of metres.
    std::vector<Rigid> without_noise;
};

// Shifts under 2 um (or 1e-5 of the largest) and turns under 5e-5 rad count as readings' noise;
// poses nearer to each other than 1 % of the largest shift and turn count as one pose. Throws
// NumericalError for no poses, or one that is not finite. Microseconds per pose.
StageMotion stage_motion(std::span<const Rigid> base_from_carriage);

// Throws NumericalError, in words, for fewer than 4 distinct poses and for a plan that moves less
// than the stage can. `reach`: transforms that show that, such as each axis moved alone.
void require_full_motion(std::span<const Rigid> plan, std::span<const Rigid> reach);

}  // namespace etalon
