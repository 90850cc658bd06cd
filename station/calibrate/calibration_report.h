// What `etalon calibrate` found: remarks, tables, calibration.json, corners.csv, report.html.
#pragma once

#include "calib/intrinsics/calibrate.h"
#include "compare/photometric/photometric_refinement.h"
#include "report/result_table.h"

namespace etalon {

// Photos that were not used because they do not share most photos' camera.
struct OtherCameras {
    std::vector<std::string> photos;
    std::string in_words;  // which they are and how they differ; empty: there are none
};

struct CalibrationRun {
    std::string target;  // its full name
    std::filesystem::path camera_file;
    std::vector<std::string> photos;  // one per view
    std::vector<CalibrationView> views;
    std::vector<std::string> without_target;
    CameraCalibration calibration;
    std::optional<PhotometricRefinement> refinement = std::nullopt;
    OtherCameras others = {};

    // The refined one where the refinement was accepted.
    const CameraModel& camera() const {
        return refinement && refinement->accepted ? refinement->camera : calibration.camera;
    }
};

// "left01.jpg" of "photos/left01.jpg".
std::string short_name(const std::string& photo);

// A value with two digits of its standard deviation: "532.83" for 0.62.
std::string with_uncertainty(double value, double deviation);

const ModelScore& chosen_score(const CameraCalibration& calibration);

std::size_t photos_used(const CameraCalibration& calibration);

// Of the centre of a telecentric camera whose model has none; and why it is held.
std::vector<std::pair<const char*, double>> held_parameters(const CameraCalibration& calibration);
inline constexpr const char* reason_held = "has no effect without distortion";

// What a measurement takes back by itself: "rotation"; telecentric: what that and a shift do.
const char* best_motion(const CameraModel& camera);

// What a reader should know before trusting the result, a sentence each; empty: nothing.
std::vector<std::string> calibration_remarks(const CalibrationRun& run);

// Photos, models and parameters with their standard deviations, for the page and for a terminal.
ResultTable photo_table(const CalibrationRun& run);
ResultTable model_table(const CalibrationRun& run);
ResultTable parameter_table(const CameraCalibration& calibration);
std::string calibration_tables(const CalibrationRun& run);

std::string calibration_json(const CalibrationRun& run);
// Where the board's points are, and where the drawing has them.
void write_board_csv(const std::filesystem::path& path, const BoardShape& board);
// "displaced by 0.148 +- 0.007 mm RMS, 0.254 mm at most; curvature ..."
std::string board_in_words(const BoardShape& board);
void write_corners_csv(const std::filesystem::path& path, const CalibrationRun& run);
std::string calibration_html(const CalibrationRun& run);

}  // namespace etalon
