// The noise of each pose's corners, where its own frames do not tell it, too: a run of which one
// pose has no noise is judged by noise all the same.
#pragma once

#include <span>
#include <vector>

#include "compare/pose/pose.h"

namespace etalon {

// Sets `noise` of each detected pose: that of its own frames; else that of the other poses' frames,
// pooled by degrees of freedom; else what the calibration's sensor states for it or, pooled, for
// others; else nothing. A variance of 0 counts as not known.
void find_noise(std::span<AnalysedPose> poses);

// Poses with several frames that left the corners at the same places to the last bit: the camera
// gave one picture again and again, or its noise is below rounding. Their indices in the plan.
std::vector<int> poses_of_equal_frames(std::span<const VisitedPose> poses);

}  // namespace etalon
