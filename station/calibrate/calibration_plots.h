// The plots of a calibration's report.
#pragma once

#include "report/html.h"
#include "station/calibrate/calibration_report.h"

namespace etalon {

HtmlPage::Figure model_figure(const CameraCalibration& calibration);
HtmlPage::Figure deviation_figure(const CameraCalibration& calibration);
HtmlPage::Figure photo_figure(const CalibrationRun& run);
HtmlPage::Figure coverage_figure(const CalibrationRun& run);
HtmlPage::Figure residual_figure(const CalibrationRun& run);
HtmlPage::Figure radial_figure(const CalibrationRun& run);
// With the camera held, and after the best rotation.
std::vector<HtmlPage::Figure> uncertainty_figures(const CameraCalibration& calibration);
// Heights, and displacements in the plane.
std::vector<HtmlPage::Figure> board_figures(const BoardShape& board);
HtmlPage::Figure halves_figure(const CameraCalibration& calibration);

}  // namespace etalon
