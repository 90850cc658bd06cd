// What the station declares about its stage, in the words of the analysis: each axis' scale and
// repeatability, and the squareness of each pair of linear axes.
#pragma once

#include <span>
#include <vector>

#include "compare/qualification.h"
#include "stage/axes.h"

namespace etalon {

// Per axis its scale, relative ("stage scale x", declared or unknown), per pair of linear axes
// their squareness ("stage squareness xy", rad, which a station file does not declare: a signature
// only). `positions`: per pose, the axes' read-back positions, mm or rad.
std::vector<DeclaredStageTerm> declared_stage_terms(
    std::span<const Axis> axes, const std::vector<std::vector<double>>& positions);

// Per axis, how far its repeatability leaves the marker's centre apart, with the marker mounted as
// designed and every axis in the middle of what was visited.
std::vector<DeclaredRepeatability> declared_repeatability(
    std::span<const Axis> axes, const std::vector<std::vector<double>>& positions,
    const Rigid& carriage_from_marker);

}  // namespace etalon
