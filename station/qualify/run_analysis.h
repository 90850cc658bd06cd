// The analysis of a run: the same for a run that has just ended and for a record that is read again
// (station/qualify/recorded_run.h). What it gives follows from `result` and the record's frames
// alone, to the bit on the same build. Touches no device and no clock.
#pragma once

#include "compare/expect/expectation.h"
#include "core/time/progress.h"
#include "report/html.h"
#include "station/qualify/photometric_poses.h"

namespace etalon {

// Judges the poses by their corners and positions, then compares each hold-out photograph with its
// render: sets their residuals and render files, writes the renders into the record's folder, and
// remarks each that could not be compared. Sets the analysis, and the outcome last. `photometric`
// is of this result. Costs what the renders cost.
//
// Throws what qualify() throws, Interrupted when a stop was requested, and ConfigError when a
// photograph of the record cannot be read or a render not be written.
void analyse_run(QualifyResult& result, PhotometricPoses& photometric, Progress& progress,
                 const std::stop_token& stop);

// Replaces what follows from the measurements: poses.csv, convergence.csv, junit.xml, report.html,
// run.json with the hashes of all files, set in the result. Throws ConfigError.
void write_results(QualifyResult& result);

// report.html: the verdict, what limits it, what the run could not see, the bias over the volume,
// photographs against renders, the budget and the run. A self-contained page that opens offline.
// Pictures are read from result.folder; the page says which cannot be read. A run that ended early
// gets the page of what it has. Throws ConfigError when the file cannot be written.
void write_qualify_report(const QualifyResult& result, const std::filesystem::path& path);

// What is to be expected of the camera, marker and detector of a run: `etalon expect` in short.
// Bias: B1 of the hold-out poses, which were rendered where the registration puts them. Noise: the
// scatter of the photographs' frames at each pose, vibration included. Nothing without an analysis.
Expectation run_expectation(const QualifyResult& result);

// A section of the report. Nothing where too few poses were rendered.
void add_run_expectation(HtmlPage& page, const QualifyResult& result);

}  // namespace etalon
