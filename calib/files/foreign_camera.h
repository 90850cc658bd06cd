// The calibration files of other tools by name: recognising, reading, writing. See docs/files.md.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

enum class CalibrationTool { opencv, ros, kalibr, mrcal, matlab, boofcv, colmap };

// opencv, ros, kalibr, mrcal, matlab, boofcv, colmap: the words of the command line.
const char* name_of(CalibrationTool tool);
const std::vector<CalibrationTool>& calibration_tools();

// What the tool calls the top-left pixel's centre along x and y: 0, 0.5 or 1 px. Here it is 0.
// Reading and writing move the principal point, exactly or within its rounding (1e-13 px).
double first_pixel_centre(CalibrationTool tool);

// Decided by the file's beginning and by keys that only one tool has; a file that no other tool
// claims is taken for ROS's. Throws ConfigError when the file cannot be read.
CalibrationTool tool_of(const std::filesystem::path& path);

// `select`: which camera of a file with several (Kalibr "cam1", COLMAP "3"); empty: the only one.
// Width and height are 0 where the file gives none. Throws ConfigError with file, line and key,
// also for a selection from a tool whose files hold one camera.
CameraModel read_foreign_camera(const std::filesystem::path& path, const std::string& select = "");

// Throws ConfigError for a coefficient or skew that the tool's model lacks. Serial, covariance
// (OpenCV: but its deviations), lens and sensor are lost: lost_in_foreign_file().
void write_foreign_camera(const std::filesystem::path& path, CalibrationTool tool,
                          const CameraModel& camera);

// What of this camera a file of this tool does not hold, in words: "serial", "covariance", ...
std::vector<std::string> lost_in_foreign_file(CalibrationTool tool, const CameraModel& camera);

}  // namespace etalon
