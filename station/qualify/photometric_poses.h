// The photometric poses of a run's photographs, from all pixels of the marker
// (compare/photometric/photometric_pose.h).
#pragma once

#include <stop_token>

#include "station/record/qualify_result.h"

namespace etalon {

// Of hold-out poses whose marker was detected, from all their whole frames in the record, starting
// at the detector's pose; a pose that gets none is named in the result's remarks. Throws
// ConfigError when a frame cannot be read and Interrupted when a stop was requested. Some 30 ms of
// CPU time per frame.
void read_photometric_poses(QualifyResult& result, const std::stop_token& stop);

}  // namespace etalon
