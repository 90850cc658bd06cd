#include "calib/files/camera_formats.h"

#include <fmt/format.h>

#include "calib/camera/camera_model.h"
#include "calib/files/foreign_camera.h"
#include "core/config/strict_reader.h"
#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

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
        return CalibrationTool::mrcal;
    for (const char* word : {"\"RadialDistortion\"", "\"IntrinsicMatrix\"", "\"FocalLength\"",
                             "\"MappingCoefficients\""})
        if (has(text, word))
            return CalibrationTool::matlab;
    return CalibrationTool::opencv;
}

}  // namespace

const char* name_of(CalibrationTool tool) {
    switch (tool) {
        case CalibrationTool::opencv:
            return "opencv";
        case CalibrationTool::ros:
            return "ros";
        case CalibrationTool::kalibr:
            return "kalibr";
        case CalibrationTool::mrcal:
            return "mrcal";
        case CalibrationTool::matlab:
            return "matlab";
        case CalibrationTool::boofcv:
            return "boofcv";
        case CalibrationTool::colmap:
            break;
    }
    return "colmap";
}

const std::vector<CalibrationTool>& calibration_tools() {
    static const std::vector<CalibrationTool> tools{
        CalibrationTool::opencv, CalibrationTool::ros,    CalibrationTool::kalibr,
        CalibrationTool::mrcal,  CalibrationTool::matlab, CalibrationTool::boofcv,
        CalibrationTool::colmap};
    return tools;
}

CalibrationTool tool_of(const std::filesystem::path& path) {
    const std::string all = read_text(path);
    const std::string_view text = after_comments(all);
    if (text.starts_with("%YAML") || text.starts_with("<?xml"))
        return CalibrationTool::opencv;
    if (text.starts_with("{"))
        return tool_of_braces(text);
    if (is_colmap_line(text))
        return CalibrationTool::colmap;
    if (has_line(text, "cam0:") || has_line(text, "cam1:"))
        return CalibrationTool::kalibr;
    if (has_line(text, "model:"))
        return CalibrationTool::boofcv;
    return CalibrationTool::ros;
}

namespace {

CameraModel read_of_tool(const std::filesystem::path& path, const std::string& select) {
    const CalibrationTool tool = tool_of(path);
    if (tool == CalibrationTool::kalibr)
        return read_kalibr_camera(path, select);
    if (tool == CalibrationTool::colmap)
        return read_colmap_camera(path, select);
    if (!select.empty())
        throw ConfigError({path.string()}, "holds one camera: there is nothing to select");
    switch (tool) {
        case CalibrationTool::opencv:
            return read_opencv_camera(path);
        case CalibrationTool::mrcal:
            return read_mrcal_camera(path);
        case CalibrationTool::matlab:
            return read_matlab_camera(path);
        case CalibrationTool::boofcv:
            return read_boofcv_camera(path);
        default:
            return read_ros_camera(path);
    }
}

}  // namespace

CameraModel read_foreign_camera(const std::filesystem::path& path, const std::string& select) {
    const CameraModel camera = read_of_tool(path, select);
    const auto coefficients = camera.distortion.coefficients();
    for (std::size_t i = 0; i < coefficients.size(); ++i)
        if (const Range range = units::one.either_sign(); !range.contains(coefficients[i]))
            throw ConfigError({path.string(), 0, distortion_names[i]},
                              fmt::format("must be {}, not {}", range.words(), coefficients[i]));
    return camera;
}

void write_foreign_camera(const std::filesystem::path& path, CalibrationTool tool,
                          const CameraModel& camera) {
    switch (tool) {
        case CalibrationTool::opencv:
            return write_opencv_camera(path, camera);
        case CalibrationTool::ros:
            return write_ros_camera(path, camera);
        case CalibrationTool::kalibr:
            return write_kalibr_camera(path, camera);
        case CalibrationTool::mrcal:
            return write_mrcal_camera(path, camera);
        case CalibrationTool::matlab:
            return write_matlab_camera(path, camera);
        case CalibrationTool::boofcv:
            return write_boofcv_camera(path, camera);
        case CalibrationTool::colmap:
            return write_colmap_camera(path, camera);
    }
}

std::vector<std::string> lost_in_foreign_file(CalibrationTool tool, const CameraModel& camera) {
    std::vector<std::string> lost;
    if (!camera.serial.empty())
        lost.push_back("serial");
    if (camera.covariance && tool != CalibrationTool::opencv)
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
