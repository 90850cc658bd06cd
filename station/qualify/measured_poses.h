// What the frames of a run say about each pose, for the analysis: mean corners and how far the
// frames leave them apart, the photometric pose, when it was taken, and which pose it repeats.
#pragma once

#include <stop_token>

#include "compare/verdict/qualification.h"
#include "station/record/qualify_result.h"

namespace etalon {

// One per visited pose, in their order. Photometric poses are of hold-out poses whose marker was
// detected, from all their whole frames in the record, starting at the detector's pose; a pose that
// gets none is named in `remarks`. Throws ConfigError when a frame cannot be read and Interrupted
// when a stop was requested. Some 30 ms of CPU time per hold-out frame.
std::vector<QualificationPose> measured_poses(const QualifyResult& result,
                                              std::vector<std::string>& remarks,
                                              const std::stop_token& stop);

// Of the mean corners, from frames that all saw the marker. Nothing with a single one of them, and
// nothing when all are alike: then rounding hides the noise, and repeats do not show rounding.
std::optional<CornerNoise> corner_noise(const PoseRecord& pose);

}  // namespace etalon
