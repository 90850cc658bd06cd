// The plots of a qualification's report: bias over the volume and pixel residuals.
#pragma once

#include "core/geometry/rigid.h"
#include "report/html.h"
#include "station/record/qualify_result.h"

namespace etalon {

// Angle between the optical axis and the marker's centre.
double off_axis_deg(const Rigid& camera_from_marker);

// B3 of the hold-out poses: as arrows across the field of view, against depth and against the
// angle to the axis, with the fitted field and the limit.
void add_bias_plots(HtmlPage& page, const QualifyResult& result);

// Residuals of photograph minus render on the hold-out poses, in a sentence and a plot.
void add_residual_summary(HtmlPage& page, const QualifyResult& result);

}  // namespace etalon
