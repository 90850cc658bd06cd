// The plots of a calibration's report.
#pragma once

#include "station/calibration_report.h"
#include "station/html.h"

namespace etalon {

HtmlPage::Figure model_figure(const CameraCalibration& calibration);
HtmlPage::Figure deviation_figure(const CameraCalibration& calibration);
HtmlPage::Figure photo_figure(const CalibrationRun& run);
HtmlPage::Figure coverage_figure(const CalibrationRun& run);
HtmlPage::Figure residual_figure(const CalibrationRun& run);
HtmlPage::Figure radial_figure(const CalibrationRun& run);
// With the camera held, and after the best rotation.
std::vector<HtmlPage::Figure> uncertainty_figures(const CameraCalibration& calibration);
HtmlPage::Figure halves_figure(const CameraCalibration& calibration);

}  // namespace etalon
