// The analysis of a run, from what was measured: the same for a run that has just ended and for one
// whose record is read again years later (station/qualify/recorded_run.h). Touches no device and no
// clock: what it gives follows from `result` and the record's frames alone, to the bit on the same
// build.
#pragma once

#include "compare/expect/expectation.h"
#include "core/time/progress.h"
#include "report/html.h"
#include "station/qualify/photometric_poses.h"

namespace etalon {

// Judges the poses by their corners and positions, then compares each hold-out photograph with its
// render: sets their residuals and render files, writes the renders into the record's folder, and
// adds a remark for each that could not be compared. Sets the analysis, and the outcome last.
//
// `photometric`: of this result, whatever was added to it before.
//
// Throws what qualify() throws, Interrupted when a stop was requested, and ConfigError when a
// photograph of the record cannot be read or a render not be written. Its cost is that of the
// renders.
void analyse_run(QualifyResult& result, PhotometricPoses& photometric, Progress& progress,
                 const std::stop_token& stop);

// Replaces everything that follows from the measurements: poses.csv, convergence.csv, junit.xml,
// report.html, and run.json with the hashes of all other files, which it sets in the result. Throws
// ConfigError when one cannot be written.
void write_results(QualifyResult& result);

// What is to be expected of the camera, marker and detector of a run: `etalon expect` in short.
// Bias: B1 of the hold-out poses, which were rendered where the registration puts them. Noise: the
// scatter of the photographs' frames at each pose, vibration included. Nothing without an analysis.
Expectation run_expectation(const QualifyResult& result);

// A section of the report. Nothing where too few poses were rendered.
void add_run_expectation(HtmlPage& page, const QualifyResult& result);

}  // namespace etalon
