// What a station declares, as the analysis takes it: for runs, records and simulations.
#pragma once

#include "station/setup/stage_terms.h"

namespace etalon {

// For these poses with their positions, in this room; of a foreseen run what is declared.
// `render_and_detect` is unset. The station must outlive the result, which points to its camera.
QualificationInput declared_input(const StationFile& station, std::vector<VisitedPose> poses,
                                  const RunEnvironment& environment = {});

}  // namespace etalon
