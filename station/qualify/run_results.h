// The files that follow from a run's measurements and its analysis.
#pragma once

#include "station/record/qualify_result.h"

namespace etalon {

// Replaces everything that follows from the measurements: poses.csv, convergence.csv, junit.xml,
// report.html, and run.json with the hashes of all other files, which it sets in the result. Throws
// ConfigError when one cannot be written.
void write_results(QualifyResult& result);

}  // namespace etalon
