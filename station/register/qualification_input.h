// What a station declares, in the words of the analysis: shared by the run itself, by whoever
// analyses its record again and by studies that simulate it.
#pragma once


#include "station/setup/stage_terms.h"

namespace etalon {

// For these poses, of which the positions are there, in this room; of a run that is only foreseen
// what is declared of it. `render_and_detect` is unset. The result points to the station's camera:
// the station must outlive it.
QualificationInput declared_input(const StationFile& station, std::vector<VisitedPose> poses,
                                  const RunEnvironment& environment = {});

}  // namespace etalon
