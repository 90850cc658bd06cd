// report.html of a qualification: the verdict on top, then what limits it, what the run could not
// see, the bias over the volume, photographs against renders, the budget and the run itself.
#pragma once

#include "report/html.h"
#include "station/record/qualify_result.h"

namespace etalon {

// Writes a self-contained page that opens offline. Pictures are read from result.folder. A run
// that ended early gets the page of what it has. Throws ConfigError when the file cannot be
// written; a picture that cannot be read is left out and the page says so.
void write_qualify_report(const QualifyResult& result, const std::filesystem::path& path);

// The decision rule of a run and what each of its judgements risks, in the report.

// Nothing where nothing was judged.
void add_decision(HtmlPage& page, const Qualification& analysis);

// The plots of a qualification's report: bias over the volume and pixel residuals.

// Angle between the optical axis and the marker's centre.
double off_axis_deg(const Rigid& camera_from_marker);

// B3 of the hold-out poses: as arrows across the field of view, against depth and against the
// angle to the axis, with the fitted field and the limit.
void add_bias_plots(HtmlPage& page, const QualifyResult& result);

// Residuals of photograph minus render on the hold-out poses, in a sentence and a plot.
void add_residual_summary(HtmlPage& page, const QualifyResult& result);

}  // namespace etalon
