// What `etalon stage` shows: the axes' states, a path, a profile, in lines of at most 79 columns;
// and the positions that are typed. Lengths in mm, angles in degrees.
#pragma once

#include "stage/profile/profile.h"
#include "station/setup/plan.h"

namespace etalon {

// "x  12.3456 mm  enabled, homed, in position", a line per axis.
std::string stage_status_text(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                              const StageProfile& profile);

// "etalon: stage/1": every axis' position with its unit, and its state.
std::string stage_status_json(std::span<const Axis> axes, std::span<const AxisStatus> statuses,
                              const StageProfile& profile);

// The motions of a plan, pose by pose, with their times and what makes them slow; and their sum.
std::string stage_plan_text(std::span<const Axis> axes, const Plan& plan);
std::string stage_plan_json(std::span<const Axis> axes, const Plan& plan);

// What a profile describes, how well that is known, and what it cannot do.
std::string stage_profile_text(const StageProfile& profile);
std::string stage_profile_json(const StageProfile& profile);

// "x=12.5" for some of the axes, in mm or degrees: the position of every axis, those that are not
// named staying at `from`; with `relative` the numbers are added to it. Throws ConfigError.
std::vector<double> typed_target(std::span<const Axis> axes, const std::vector<std::string>& words,
                                 std::span<const double> from, bool relative);

}  // namespace etalon
