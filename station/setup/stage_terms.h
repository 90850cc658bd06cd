// What the station declares about its stage, in the words of the analysis: each axis' scale,
// direction, point, repeatability and error map, and the squareness of each pair of linear axes.
// Of the poses only the positions read back count, with their standard uncertainties.
#pragma once

#include "station/setup/plan.h"

namespace etalon {

// Per axis its scale about its zero, relative ("stage scale x", declared or unknown); per pair of
// linear axes their squareness ("stage squareness xy", rad: a signature only); and per axis whose
// direction or point has a declared uncertainty, two terms each for the two ways in which it can be
// off ("stage direction x, 1st way", rad; "stage point rz, 2nd way", mm).
std::vector<DeclaredStageTerm> declared_stage_terms(std::span<const Axis> axes,
                                                    const std::vector<VisitedPose>& poses);

// Per axis, how far its repeatability, its backlash and its reading leave the marker's centre
// apart, with the marker mounted as designed and every axis in the middle of what was visited.
std::vector<DeclaredRepeatability> declared_repeatability(std::span<const Axis> axes,
                                                          const std::vector<VisitedPose>& poses,
                                                          const Rigid& carriage_from_marker);

// Per axis positions, sides of approach, and the carriage had it gone further or stood aside.
std::vector<StageAxisMotion> stage_axis_motions(std::span<const Axis> axes,
                                                const std::vector<VisitedPose>& poses);

// Per axis with an error map: shift of the marker's centre by its uncertainty, RMS and largest.
std::vector<DeclaredErrorMap> declared_error_maps(std::span<const Axis> axes,
                                                  const std::vector<VisitedPose>& poses,
                                                  const Rigid& carriage_from_marker);

// Each axis at several places of its interval, the others in the middle of theirs: what the stage
// can do there, for require_full_motion() (calib/registration/stage_motion.h). One interval per
// axis, mm or rad, within its soft limits; without intervals all of its travel.
std::vector<Rigid> stage_reach(const std::vector<Axis>& axes,
                               std::span<const PlanRequest::Interval> intervals);
std::vector<Rigid> stage_reach(const std::vector<Axis>& axes);

}  // namespace etalon
