// What is to be expected of the camera, marker and detector of a run: `etalon expect` in short,
// from renders and frames that the run has anyway.
#pragma once

#include "compare/expect/expectation.h"
#include "report/html.h"
#include "station/record/qualify_result.h"

namespace etalon {

// Bias: B1 of the hold-out poses, which were rendered where the registration puts them. Noise: the
// scatter of the photographs' frames at each pose, vibration included. Nothing without an analysis.
Expectation run_expectation(const QualifyResult& result);

// A section of the report. Nothing where too few poses were rendered.
void add_run_expectation(HtmlPage& page, const QualifyResult& result);

}  // namespace etalon
