// Carries a study out: every pose that its record does not hold yet, in parallel, written in order.
#pragma once

#include "core/time/progress.h"
#include "study/study_results.h"

namespace etalon {

struct StudyRun {
    std::size_t poses = 0;  // evaluated now
    bool complete = false;  // false: stopped before the last pose
    StudyTimes times;
    double cpu_ms = 0.0, wall_ms = 0.0;  // of the whole run
};

// A stop request lets the poses in work be finished. Results depend neither on threads nor on
// order; as many images are in memory as there are threads. Throws what StudyRecord::add throws,
// ConfigError for an external detector that cannot be started, and NumericalError for a volume into
// which the markers hardly fit.
StudyRun run_study(const StudyOptics& optics, const Shard& shard, StudyRecord& record,
                   std::stop_token stop, Progress& progress);

}  // namespace etalon
