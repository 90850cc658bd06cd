#include "calib/files/foreign_camera.h"

#include <fmt/format.h>

#include "calib/files/foreign_file.h"
#include "core/file/text.h"

namespace etalon {
namespace {

struct Format {
    CalibrationTool tool;
    const char* name;
    double first_pixel_centre;  // px
    CameraModel (*read)(const std::filesystem::path& path);
    CameraModel (*read_selected)(const std::filesystem::path& path, const std::string& select);
    void (*write)(const std::filesystem::path& path, const CameraModel& camera);
};

// Of the words of the command line, one of `read` and `read_selected` each. Sources of the centres:
//   OpenCV, ROS    pixel centres at integers; ROS's camera_calibration calls cv::calibrateCamera
//   Kalibr         ends in cv::cornerSubPix (issue 115 tries both detectors on drawn images)
//   mrcal          "No changes to the content are made" from and to ROS' and Kalibr's models
//                  (mrcal-from-ros(1), mrcal-to-kalibr(1))
//   MATLAB         "specifies the pixel center at (1,1)" (cameraIntrinsicsToOpenCV)
//   BoofCV         its simulator (SimulatePlanarWorld.computeProjectionTable) and its chessboard
//                  detector, which adds 0.5 (DetectChessboardCornersX.process); no document says so
//   COLMAP         "the center of the upper left most pixel has coordinate (0.5, 0.5)" (tutorial)
using enum CalibrationTool;
constexpr std::array formats{
    Format{opencv, "opencv", 0.0, read_opencv_camera, nullptr, write_opencv_camera},
    Format{ros, "ros", 0.0, read_ros_camera, nullptr, write_ros_camera},
    Format{kalibr, "kalibr", 0.0, nullptr, read_kalibr_camera, write_kalibr_camera},
    Format{mrcal, "mrcal", 0.0, read_mrcal_camera, nullptr, write_mrcal_camera},
    Format{matlab, "matlab", 1.0, read_matlab_camera, nullptr, write_matlab_camera},
    Format{boofcv, "boofcv", 0.5, read_boofcv_camera, nullptr, write_boofcv_camera},
    Format{colmap, "colmap", 0.5, nullptr, read_colmap_camera, write_colmap_camera}};

const Format& format_of(CalibrationTool tool) {
    return *std::ranges::find(formats, tool, &Format::tool);
}

// The text from the first line on that is neither empty nor a comment.
std::string_view after_comments(std::string_view text) {
    text = trimmed(text);
    while (text.starts_with('#')) {
        const std::size_t end = text.find('\n');
        text = end == std::string_view::npos ? "" : trimmed(text.substr(end));
    }
    return text;
}

bool has(std::string_view text, std::string_view word) {
    return text.find(word) != std::string_view::npos;
}

bool has_line(std::string_view text, std::string_view beginning) {
    return text.starts_with(beginning) || has(text, "\n" + std::string(beginning));
}

// COLMAP's lines: a number, then a model's name in capitals.
bool is_colmap_line(std::string_view text) {
    const std::size_t end = text.find_first_not_of("0123456789");
    if (end == 0 || end == std::string_view::npos || text[end] != ' ')
        return false;
    const std::size_t word = text.find_first_not_of(' ', end);
    return word != std::string_view::npos && text[word] >= 'A' && text[word] <= 'Z';
}

CalibrationTool tool_of_braces(std::string_view text) {
    if (has(text, "lensmodel") || has(text, "lens_model"))
        return mrcal;
    for (const char* word : {"\"RadialDistortion\"", "\"IntrinsicMatrix\"", "\"FocalLength\"",
                             "\"MappingCoefficients\""})
        if (has(text, word))
            return matlab;
    return opencv;
}

}  // namespace

const char* name_of(CalibrationTool tool) {
    return format_of(tool).name;
}

const std::vector<CalibrationTool>& calibration_tools() {
    static const std::vector tools{opencv, ros, kalibr, mrcal, matlab, boofcv, colmap};
    return tools;
}

double first_pixel_centre(CalibrationTool tool) {
    return format_of(tool).first_pixel_centre;
}

CalibrationTool tool_of(const std::filesystem::path& path) {
    const std::string all = read_text(path);
    const std::string_view text = after_comments(all);
    if (text.starts_with("%YAML") || text.starts_with("<?xml"))
        return opencv;
    if (text.starts_with("{"))
        return tool_of_braces(text);
    if (is_colmap_line(text))
        return colmap;
    if (has_line(text, "cam0:") || has_line(text, "cam1:"))
        return kalibr;
    if (has_line(text, "model:"))
        return boofcv;
    if (has_line(text, "image:") && has_line(text, "intrinsics:"))
        throw ConfigError({path.string(), 1}, "must begin with 'etalon: camera/1'");
    return ros;
}

CameraModel read_foreign_camera(const std::filesystem::path& path, const std::string& select) {
    const Format& format = format_of(tool_of(path));
    if (format.read && !select.empty())
        throw ConfigError({path.string()}, "holds one camera: there is nothing to select");
    CameraModel camera = format.read ? format.read(path) : format.read_selected(path, select);
    camera.intrinsics.cx -= format.first_pixel_centre;
    camera.intrinsics.cy -= format.first_pixel_centre;
    const auto coefficients = camera.distortion.coefficients();
    for (std::size_t i = 0; i < coefficients.size(); ++i)
        if (const Range range = units::one.either_sign(); !range.contains(coefficients[i]))
            throw ConfigError({path.string(), 0, distortion_names[i]},
                              fmt::format("must be {}, not {}", range.words(), coefficients[i]));
    return camera;
}

void write_foreign_camera(const std::filesystem::path& path, CalibrationTool tool,
                          const CameraModel& camera) {
    const Format& format = format_of(tool);
    CameraModel written = camera;
    written.intrinsics.cx += format.first_pixel_centre;
    written.intrinsics.cy += format.first_pixel_centre;
    format.write(path, written);
}

std::vector<std::string> lost_in_foreign_file(CalibrationTool tool, const CameraModel& camera) {
    std::vector<std::string> lost;
    if (!camera.serial.empty())
        lost.push_back("serial");
    if (camera.covariance && tool != opencv)
        lost.push_back("covariance");
    else if (camera.covariance && !camera.covariance->matrix.isDiagonal(0.0))
        lost.push_back("correlations of the covariance");
    if (camera.lens)
        lost.push_back("lens");
    if (camera.sensor)
        lost.push_back("sensor");
    return lost;
}

}  // namespace etalon
