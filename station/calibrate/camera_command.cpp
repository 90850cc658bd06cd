// `etalon camera`: looks at, converts and checks a calibration, of ours or of another tool.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "calib/files/foreign_camera.h"
#include "calib/intrinsics/camera_check.h"
#include "core/config/strict_reader.h"
#include "core/program/print_stderr.h"
#include "station/calibrate/commands.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

CameraModel selected_camera(const CameraFileArguments& arguments) {
    if (arguments.select.empty())
        return read_any_camera(arguments.file);
    if (is_etalon_file(arguments.file))
        throw ConfigError({"--select"}, "is for files with several cameras, Kalibr's and COLMAP's");
    return read_foreign_camera(arguments.file, arguments.select);
}

const char* format_of(const CameraFileArguments& arguments) {
    return is_etalon_file(arguments.file) ? "etalon" : name_of(tool_of(arguments.file));
}

nlohmann::json camera_json(const CameraModel& camera, const char* format) {
    const Intrinsics& i = camera.intrinsics;
    nlohmann::json distortion = nlohmann::json::object();
    const auto coefficients = camera.distortion.coefficients();
    for (std::size_t k = 0; k < coefficients.size(); ++k)
        distortion[distortion_names[k]] = coefficients[k];
    nlohmann::json parameters = nlohmann::json::object();
    for (const auto& [name, value] : named_parameters(camera.projection))
        parameters[name] = value;
    return {
        {"format", format},
        {"serial", camera.serial},
        {"width", camera.width},
        {"height", camera.height},
        {"projection", name_of(camera.projection.kind).name},
        {"projection_parameters", parameters},
        {"intrinsics", {{"fx", i.fx}, {"fy", i.fy}, {"cx", i.cx}, {"cy", i.cy}, {"skew", i.skew}}},
        {"distortion", distortion},
        {"covariance", camera.covariance.has_value()},
        {"lens", camera.lens.has_value()},
        {"sensor", camera.sensor.has_value()}};
}

std::string standard_deviation(const CameraModel& camera, const char* name) {
    if (!camera.covariance)
        return "";
    const auto& order = camera.covariance->order;
    const auto at = std::find(order.begin(), order.end(), name);
    if (at == order.end())
        return "";
    const Eigen::Index k = at - order.begin();
    return fmt::format("  +- {:.3g}", std::sqrt(camera.covariance->matrix(k, k)));
}

// What was measured of lens and sensor, and how well it is known.
void print_uncertainties(const CameraModel& camera) {
    if (!camera.standard_uncertainty)
        return;
    const auto line = [](const char* name, double value, const std::optional<double>& u) {
        if (u)
            fmt::print("{:<11} {}  +- {:.3g}\n", name, value, *u);
    };
    const CameraUncertainty& u = *camera.standard_uncertainty;
    if (camera.lens) {
        line("f_number", camera.lens->f_number, u.f_number);
        line("focus mm", camera.lens->focus_distance_mm, u.focus_distance_mm);
        line("psf sigma", camera.lens->psf.sigma_px, u.psf_sigma_px);
    }
    if (camera.sensor) {
        line("black", camera.sensor->black_dn, u.black_dn);
        line("gain e/DN", camera.sensor->gain_e_per_dn, u.gain_e_per_dn);
        line("read e", camera.sensor->read_noise_e, u.read_noise_e);
    }
}

void print_camera(const CameraModel& camera, const char* format) {
    const Intrinsics& i = camera.intrinsics;
    const bool is_perspective = camera.projection.kind == Projection::perspective;
    fmt::print("format      {}\nimage       {} x {} px{}{}\n", format, camera.width, camera.height,
               is_perspective ? "" : ", ",
               is_perspective ? "" : name_of(camera.projection.kind).name);
    if (!camera.serial.empty())
        fmt::print("serial      {}\n", camera.serial);
    const std::array values{i.fx, i.fy, i.cx, i.cy};
    for (std::size_t k = 0; k < values.size(); ++k)
        fmt::print("{:<11} {}{}\n", intrinsic_names[k], values[k],
                   standard_deviation(camera, intrinsic_names[k]));
    if (i.skew != 0.0)
        fmt::print("{:<11} {}{}\n", "skew", i.skew, standard_deviation(camera, "skew"));
    for (const auto& [name, value] : named_parameters(camera.projection))
        fmt::print("{:<11} {}{}\n", name, value, standard_deviation(camera, name));
    const auto coefficients = camera.distortion.coefficients();
    for (std::size_t k = 0; k < coefficients.size(); ++k)
        if (coefficients[k] != 0.0)
            fmt::print("{:<11} {}{}\n", distortion_names[k], coefficients[k],
                       standard_deviation(camera, distortion_names[k]));
    fmt::print("lens        {}\nsensor      {}\n", camera.lens ? "known" : "not known",
               camera.sensor ? "known" : "not known");
    print_uncertainties(camera);
}

const char* word_of(CameraFinding::Weight weight) {
    return weight == CameraFinding::Weight::fault     ? "FAULT"
           : weight == CameraFinding::Weight::warning ? "warning"
                                                      : "note";
}

// Infinity and NaN become null.
nlohmann::json check_json(const CameraCheck& check, bool is_telecentric) {
    nlohmann::json findings = nlohmann::json::array();
    for (const CameraFinding& finding : check.findings)
        findings.push_back({{"weight", word_of(finding.weight)},
                            {"about", finding.about},
                            {"message", finding.message}});
    const auto field = [](double horizontal, double vertical, double diagonal) -> nlohmann::json {
        return {{"horizontal", horizontal}, {"vertical", vertical}, {"diagonal", diagonal}};
    };
    return {{is_telecentric ? "field_of_view_mm" : "field_of_view_deg",
             is_telecentric ? field(check.horizontal_mm, check.vertical_mm, check.diagonal_mm)
                            : field(check.horizontal_deg, check.vertical_deg, check.diagonal_deg)},
            {"image_without_ray", check.image_without_ray},
            {"margin", check.margin},
            {"findings", findings}};
}

std::string extent(double value) {
    return std::isnan(value) ? "no ray" : fmt::format("{:.2f}", value);
}

void print_check(const CameraCheck& check, bool is_telecentric) {
    if (is_telecentric)
        fmt::print("field of view  {} x {} mm, diagonal {}\n", extent(check.horizontal_mm),
                   extent(check.vertical_mm), extent(check.diagonal_mm));
    else
        fmt::print("field of view  {} x {} degrees, diagonal {}\n", extent(check.horizontal_deg),
                   extent(check.vertical_deg), extent(check.diagonal_deg));
    fmt::print("valid region   {}\n", std::isinf(check.margin)
                                          ? "without an end"
                                          : fmt::format("to {:.3f} times the radius of the image's "
                                                        "edge",
                                                        check.margin));
    for (const CameraFinding& finding : check.findings)
        fmt::print("{:<8} {}: {}\n", word_of(finding.weight), finding.about, finding.message);
}

CalibrationTool tool_named(const std::string& name) {
    for (const CalibrationTool tool : calibration_tools())
        if (name == name_of(tool))
            return tool;
    throw ConfigError(
        {"--to"},
        "must be etalon, opencv, ros, kalibr, mrcal, matlab, boofcv or colmap, not '" + name + "'");
}

}  // namespace

int run_camera_show(const CameraFileArguments& arguments) {
    const CameraModel camera = selected_camera(arguments);
    if (arguments.json)
        fmt::print("{}\n", camera_json(camera, format_of(arguments)).dump(2));
    else
        print_camera(camera, format_of(arguments));
    return 0;
}

int run_camera_convert(const CameraFileArguments& arguments) {
    const CameraModel camera = selected_camera(arguments);
    std::vector<std::string> lost;
    if (arguments.to == "etalon") {
        write_camera(arguments.out, camera);
    } else {
        const CalibrationTool tool = tool_named(arguments.to);
        write_foreign_camera(arguments.out, tool, camera);
        lost = lost_in_foreign_file(tool, camera);
    }
    if (!lost.empty())
        print_stderr("etalon: left out, having no place there: {}\n", fmt::join(lost, ", "));
    if (arguments.json)
        fmt::print("{}\n",
                   nlohmann::json{{"file", arguments.out.string()}, {"left_out", lost}}.dump(2));
    else
        fmt::print("camera {}\n", arguments.out.string());
    return 0;
}

int run_camera_check(const CameraFileArguments& arguments) {
    const CameraModel camera = selected_camera(arguments);
    const CameraCheck check = check_camera(camera);
    const bool is_telecentric = camera.projection.kind == Projection::telecentric;
    if (arguments.json)
        fmt::print("{}\n", check_json(check, is_telecentric).dump(2));
    else
        print_check(check, is_telecentric);
    return check.has_fault() ? ExitCode::fail : 0;
}

Declared<CameraFileArguments> declare_on_file(Command& camera,
                                              int (*action)(const CameraFileArguments&),
                                              const char* name, const char* summary,
                                              const char* details) {
    auto [command, asked] = camera.add(action, name, summary, details);
    command.required("CAMERA", asked->file, "calibration: ours or another tool's");
    command.option("--select", asked->select,
                   "which camera of a file with several:\ncam1 (Kalibr), 3 (COLMAP)", "NAME");
    return {command, asked};
}

void declare_camera(Command& program) {
    Command camera = program.add_group("camera", "show, convert and check a calibration");
    declare_on_file(camera, run_camera_show, "show", "print what the file says", "");
    auto [convert, asked] = declare_on_file(
        camera, run_camera_convert, "convert", "write it as another tool's file",
        "Pixel origins are converted. A coefficient that the tool does not have is an\n"
        "error; what else it has no place for is named on stderr. Prints `camera FILE`.\n");
    convert.required("--to", asked->to,
                     "etalon, opencv, ros, kalibr, mrcal, matlab, boofcv\nor colmap", "TOOL");
    convert.required("--out", asked->out, "file to write", "FILE");
    declare_on_file(camera, run_camera_check, "check", "check that the whole image can be used",
                    "Field of view, where the distortion model ends, what is unusual, and what\n"
                    "the renderer will miss. Exit code 1 when part of the image has no ray.\n");
}

}  // namespace etalon
