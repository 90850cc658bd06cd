// `etalon characterise`: what a camera's lens and sensor do, measured from photographs and written
// into its camera file. The measuring is in compare/characterise/characterisation.cpp.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "compare/photo_pose.h"
#include "core/config/csv_file.h"
#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "report/html.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "report/svg_plot.h"
#include "sim/sensor/sensor_model.h"
#include "station/calibrate/characterise_help.txt.h"
#include "station/calibrate/commands.h"
#include "station/shell/command.h"
#include "station/shell/photo_files.h"

namespace etalon {
namespace {

using Paths = std::vector<std::filesystem::path>;

CharacteriseInput read_input(const CharacteriseArguments& arguments) {
    Paths exposed;
    std::vector<double> exposures_us;
    if (!arguments.exposures.empty())  // files are seen from the CSV's folder
        for (const CsvRow& row : read_csv(arguments.exposures, {"file,exposure_us"}).rows) {
            exposures_us.push_back(row.number(1, units::us.positive()));
            exposed.push_back(arguments.exposures.parent_path() / row.cells[0]);
        }
    const auto joined = [](std::initializer_list<const Paths*> lists) {
        Paths all;
        for (const Paths* list : lists)
            all.insert(all.end(), list->begin(), list->end());
        return all;
    };
    const Paths of_noise = joined({&arguments.repeats, &arguments.darks, &exposed});
    const Paths all = joined({&arguments.photos, &arguments.flats, &of_noise});
    if (all.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    CharacteriseInput input{.camera = read_camera_for(arguments.camera, all),
                            .target = parse_calibration_target(arguments.target, "--target")};
    require_distinct(all);
    const auto read = [&](const std::filesystem::path& path) {
        return read_photo(path, input.camera, arguments.camera);
    };
    for (const auto& path : arguments.photos)
        input.photos.push_back({path.string(), read(path)});
    for (const auto& path : arguments.flats)
        input.flats.push_back({path.string(), read(path)});
    std::ranges::transform(arguments.repeats, std::back_inserter(input.repeats), read);
    std::ranges::transform(arguments.darks, std::back_inserter(input.darks), read);
    for (std::size_t i = 0; i < exposed.size(); ++i)
        input.exposures.push_back({read(exposed[i]), exposures_us[i], exposed[i].string()});
    if (const auto lossy = std::ranges::find_if(of_noise, is_jpeg); lossy != of_noise.end())
        input.lossy_file = lossy->string();
    return input;
}

const char* word(Transfer::Kind kind) {
    constexpr std::array words{"linear", "rec709", "table"};
    return words[static_cast<std::size_t>(kind)];
}

const char* word(Illumination::Kind kind) {
    constexpr std::array words{"uniform", "cos4", "polynomial"};
    return words[static_cast<std::size_t>(kind)];
}

// One line each, `WORDS VALUE +- U UNIT`: U = 2u, two digits of it.
void print_words(const Characterisation& result) {
    for (const MeasuredValue& value : result.values)
        fmt::print("{}\n", with_uncertainty(value));
    if (result.transfer)
        fmt::print("transfer {}\n", word(result.transfer->transfer.kind));
    if (result.illumination)
        fmt::print("illumination {}\n", word(result.illumination->illumination.kind));
    for (const NotMeasured& missing : result.not_measured)
        fmt::print("{}: {}: {}\n", missing.was_refused ? "refused" : "not measured",
                   missing.quantity, missing.reason);
}

Json values_json(const Characterisation& result) {
    Json json = Json::object();
    for (const MeasuredValue& value : result.values)
        json[value.key] = {{"value", value.value},
                           {"standard_uncertainty", value.standard_uncertainty},
                           {"expanded_uncertainty", 2.0 * value.standard_uncertainty},
                           {"coverage_factor", 2},
                           {"unit", value.unit},
                           {"from", value.how},
                           {"written", value.is_written}};
    return json;
}

Json json_of(const TransferCandidate& candidate) {
    return {{"kind", word(candidate.kind)},
            {"chi_square", candidate.chi_square},
            {"degrees_of_freedom", candidate.degrees_of_freedom},
            {"bic", candidate.information_criterion}};
}

Json json_of(const NoiseLevel& level) {
    return {{"signal_dn", level.signal_dn},
            {"variance_dn2", level.variance_dn2},
            {"standard_uncertainty_dn2", level.standard_uncertainty_dn2},
            {"used", level.is_used}};
}

Json json_of(const NotMeasured& missing) {
    return {{"quantity", missing.quantity},
            {"reason", missing.reason},
            {"refused", missing.was_refused}};
}

Json json_of(const ModulationRow& row) {
    return {row.cycles_per_px, row.modulation, row.standard_uncertainty};
}

Json json_of(const std::optional<BlurWidth>& zone) {
    return zone ? Json{{"sigma_px", zone->sigma_px},
                       {"standard_uncertainty", zone->standard_uncertainty_px},
                       {"edges", zone->edges}}
                : Json(nullptr);
}

Json json_of(const EdgeModulation& at) {
    return {{"photo", at.photo},
            {"centre_px", {at.centre_px.x(), at.centre_px.y()}},
            {"angle_deg", at.edge.angle_deg},
            {"mtf50_cycles_per_px", at.edge.mtf50_cycles_per_px},
            {"at_nyquist", at.edge.at_nyquist},
            {"rows",
             json_list(at.edge.modulation, [](const ModulationRow& row) { return json_of(row); })}};
}

template <class List>
Json list_of(const List& list) {
    return json_list(list, [](const auto& each) { return json_of(each); });
}

Json transfer_json(const TransferEstimate& estimate) {
    Json json = {{"kind", word(estimate.transfer.kind)},
                 {"candidates", list_of(estimate.candidates)},
                 {"lowest_code", estimate.lowest_code},
                 {"highest_code", estimate.highest_code},
                 {"saturation_code", estimate.saturation_code}};
    add_present(json, "light_drift", estimate.light_drift);
    return json;
}

Json photon_transfer_json(const PhotonTransfer& photon) {
    return {{"reduced_chi_square", photon.reduced_chi_square},
            {"degrees_of_freedom", photon.degrees_of_freedom},
            {"covariance_gain_read_noise", photon.covariance(0, 1)},
            {"brightness_drift", photon.brightness_drift},
            {"shift_px", photon.shift_px},
            {"noise_correlation", photon.noise_correlation},
            {"saturation_code", photon.saturation_code},
            {"levels", list_of(photon.levels)}};
}

Json illumination_json(const Characterisation& result) {
    const IlluminationEstimate& estimate = *result.illumination;
    Json covariance = Json::array();
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j <= i; ++j)
            covariance.push_back(estimate.covariance(i, j));
    return {{"kind", word(estimate.illumination.kind)},
            {"from", result.illumination_from},
            {"polynomial", estimate.coefficients},
            {"standard_uncertainty", estimate.standard_uncertainty},
            {"covariance_lower", covariance},
            {"reduced_chi_square", estimate.reduced_chi_square},
            {"farthest_radius", estimate.farthest_radius}};
}

void print_json(const CharacteriseArguments& arguments, const Characterisation& result) {
    Json json = {
        {"etalon", "characterisation/1"}, {"camera", arguments.out.string()},
        {"target", arguments.target},     {"photos_with_target", result.photos_with_target},
        {"values", values_json(result)},  {"not_measured", list_of(result.not_measured)},
        {"remarks", result.remarks}};
    add_present(json, "transfer", result.transfer, transfer_json);
    add_present(json, "photon_transfer", result.photon_transfer, photon_transfer_json);
    if (result.illumination)
        json["illumination"] = illumination_json(result);
    if (result.point_spread)
        json["psf_zones"] = list_of(result.point_spread->zones);
    json["modulation"] = list_of(result.modulation);
    std::puts(text_of(json).c_str());
}

// ---- the page: every value with its uncertainty, and the curves behind them

void add_summary(HtmlPage& page, const Characterisation& result) {
    const auto written = std::ranges::count_if(result.values, &MeasuredValue::is_written);
    std::vector<std::string> missing;
    for (const NotMeasured& entry : result.not_measured)
        missing.push_back(fmt::format("{} ({}): {}", entry.quantity,
                                      entry.was_refused ? "refused" : "not measured",
                                      entry.reason));
    page.add_verdict(counted(result.values.size(), "value"),
                     fmt::format("measured, {} of them for the camera's file; {} could not be "
                                 "measured.",
                                 written, counted(missing.size(), "quantity", "quantities")),
                     {{"Before you trust them", result.remarks}, {"Not measured", missing}});
}

void add_values(HtmlPage& page, const Characterisation& result) {
    TableRows rows;
    for (const MeasuredValue& value : result.values) {
        const int decimals = decimals_of(2.0 * value.standard_uncertainty);
        rows.push_back({value.words, fixed(value.value, decimals),
                        fixed(2.0 * value.standard_uncertainty, decimals),
                        fixed(value.standard_uncertainty, decimals + 1), value.unit,
                        value.is_written ? "yes" : "no", value.how});
    }
    page.add_table({"quantity", "value", "U (k = 2)", "u", "unit", "in the camera file", "from"},
                   rows);
}

HtmlPage::Figure photon_transfer_plot(const PhotonTransfer& photon) {
    Series measured, left_out, model;
    for (const NoiseLevel& level : photon.levels) {
        model.add(level.signal_dn, level.model_dn2);
        if (level.is_used)
            measured.add(level.signal_dn, level.variance_dn2,
                         fmt::format("{:.1f} DN: {:.3f} ± {:.3f} DN² (k = 2), {:.0f} pixels",
                                     level.signal_dn, level.variance_dn2,
                                     2.0 * level.standard_uncertainty_dn2, level.pixels));
        else
            left_out.add(level.signal_dn, level.variance_dn2);
    }
    SvgPlot plot("linear signal above black, DN", "temporal variance, DN²");
    plot.add_line(model, Color::gray, "read and photon noise");
    plot.add_points(measured, Color::blue, "measured");
    if (!left_out.empty())
        plot.add_points(left_out, Color::orange, "left out (clipped, rounding)");
    return {plot.svg(),
            fmt::format(
                "Photon transfer: variance between repeats against signal. Slope 1/gain, "
                "height at 0 the read noise; rounding is taken out. Reduced chi-square {:.2f} "
                "with {} degrees of freedom; between the repeats the light changed by {:.2g} % "
                "and the view by {:.2g} px. Look for points off the line: light or view changed.",
                photon.reduced_chi_square, photon.degrees_of_freedom,
                100.0 * photon.brightness_drift, photon.shift_px)};
}

HtmlPage::Figure transfer_plot(const TransferEstimate& estimate) {
    SvgPlot plot("radiance, 1 at saturation", "code above black / range");
    Series patches, curve;
    for (const TransferPoint& point : estimate.points)
        patches.add(point.radiance, point.code);
    for (int i = 0; i <= 100; ++i)
        curve.add(i / 100.0, encode(estimate.transfer, i / 100.0));
    const std::vector<double> ends{0.0, 1.0};
    plot.add_line({ends, ends}, Color::gray, "straight line");
    plot.add_points(patches, Color::blue, "patches");
    plot.add_line(curve, Color::red, "transfer curve");
    return {plot.svg(),
            fmt::format(
                "Transfer curve from {} patches in {} photos, seen from {:.3f} to {:.3f} of full "
                "scale and continued beyond. Points beside the curve are patches in uneven light.",
                estimate.patches, estimate.photos, estimate.lowest_code, estimate.highest_code)};
}

// What the curve itself hides: how far the patches are from a straight line through black.
HtmlPage::Figure nonlinearity_plot(const TransferEstimate& estimate) {
    double product = 0.0, square = 0.0;
    for (const TransferPoint& point : estimate.points) {
        product += point.radiance * point.code;
        square += point.radiance * point.radiance;
    }
    Series patches;
    for (const TransferPoint& point : estimate.points)
        patches.add(100.0 * point.code, 100.0 * (point.code - point.radiance * product / square));
    SvgPlot plot("code above black, % of range", "off the straight line, % of range");
    plot.add_points(patches, Color::blue, "patches");
    plot.add_level(0.0, Color::gray, "");
    return {plot.svg(),
            fmt::format("The patches' departure from the straight line through black that fits "
                        "them best; a bend is a tone curve. Largest of the measured curve between "
                        "5 and 95 %: {:.3f} % ± {:.3f} % (k = 2).",
                        100.0 * estimate.nonlinearity,
                        200.0 * estimate.nonlinearity_standard_uncertainty)};
}

HtmlPage::Figure illumination_plot(const CameraModel& camera,
                                   const IlluminationEstimate& estimate) {
    constexpr std::size_t max_points = 500;
    Series white_parts, curve;
    // Odd, or every eighth of forty blocks a row would be the same ones.
    const std::size_t every = (1 + estimate.used.size() / max_points) | 1;
    for (std::size_t i = 0; i < estimate.used.size(); i += every) {
        const WhitePatch& patch = estimate.used[i];
        white_parts.add(std::sqrt(illumination_radius_squared(camera, patch.centre_px)),
                        patch.radiance);
    }
    const double end =
        white_parts.empty() ? 1.0 : *std::max_element(white_parts.xs.begin(), white_parts.xs.end());
    for (int i = 0; i <= 50; ++i) {
        const double radius = end * i / 50.0;
        const double value = polynomial_illumination(estimate.coefficients, radius * radius);
        const double expanded = 2.0 * standard_uncertainty_at(estimate, radius);
        curve.add(radius, value, value - expanded, value + expanded);
    }
    SvgPlot plot("distance from the principal point, half diagonals", "relative illumination");
    plot.add_points(white_parts, Color::gray,
                    every == 1 ? "white parts" : "some of the white parts");
    plot.add_band(curve, Color::red, "U (k = 2)");
    plot.add_line(curve, Color::red, "polynomial");
    return {plot.svg(), fmt::format("Relative illumination: white parts, their photo's own level "
                                    "and plane divided out; they scatter by {:.2g} %. Look whether "
                                    "they follow the curve to the end: beyond it nothing was seen.",
                                    100.0 * estimate.residual_rms)};
}

HtmlPage::Figure illumination_map(const CameraModel& camera, const IlluminationEstimate& estimate) {
    constexpr int width = 320;
    const double scale = static_cast<double>(camera.width) / width;
    const int height = std::max(1, static_cast<int>(camera.height / scale));
    cv::Mat picture(height, width, CV_8UC1);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const Eigen::Vector2d pixel((x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5);
            const double value = polynomial_illumination(
                estimate.coefficients, illumination_radius_squared(camera, pixel));
            // Steps of 2 % stand out as contours.
            const double stepped = std::floor(value * 50.0) / 50.0;
            picture.at<uchar>(y, x) = cv::saturate_cast<uchar>(255.0 * stepped);
        }
    return {embedded_png(picture, "relative illumination over the image"),
            fmt::format("Relative illumination over the image in steps of 2 %; {:.1f} % in the "
                        "farthest corner. Rings off the middle are vignetting off the axis.",
                        100.0 * estimate.at_corner)};
}

HtmlPage::Figure modulation_plot(const Characterisation& result) {
    constexpr std::array inks{Color::blue, Color::orange, Color::green, Color::red, Color::gray};
    SvgPlot plot("spatial frequency, cycles per px", "modulation");
    plot.set_y_range(0.0, 1.1);
    for (std::size_t i = 0; i < result.modulation.size(); ++i) {
        const EdgeModulation& at = result.modulation[i];
        Series edge;
        for (const ModulationRow& row : at.edge.modulation)
            edge.add(row.cycles_per_px, row.modulation);
        plot.add_line(edge, inks[i % inks.size()],
                      fmt::format("({:.0f}, {:.0f})", at.centre_px.x(), at.centre_px.y()));
    }
    return {plot.svg(),
            "Slanted-edge MTF (ISO 12233) of lens, pixel and camera together, one edge for each "
            "part of the image (its middle in px), in linear radiance. A curve above 1 tells of "
            "sharpening, one that lies far below the others of blur in its part."};
}

HtmlPage::Figure edge_spread_plot(const PointSpreadEstimate& spread) {
    Series mean;
    for (const EdgeSpreadRow& row : spread.edge_spread)
        mean.add(row.distance_px, row.value, row.value - 2.0 * row.standard_uncertainty,
                 row.value + 2.0 * row.standard_uncertainty);
    SvgPlot plot("distance from the edge, px", "part of the contrast");
    plot.add_band(mean, Color::blue, "U (k = 2)");
    plot.add_line(mean, Color::blue, "mean of all edges");
    return {plot.svg(),
            fmt::format("Edge spread; look for bumps before and behind the edge. Overshoot {:.2f} "
                        "%, undershoot {:.2f} % of the contrast: {}.",
                        100.0 * spread.sharpening.overshoot, 100.0 * spread.sharpening.undershoot,
                        spread.sharpening.is_detected ? "the camera sharpens"
                                                      : "no sharpening in the camera")};
}

void add_zones(HtmlPage& page, const PointSpreadEstimate& spread) {
    page.add_heading("Blur by part of the image");
    TableRows rows;
    for (std::size_t row = 0; row < 3; ++row) {
        std::vector<std::string> cells{std::array{"top", "middle", "bottom"}[row]};
        for (std::size_t column = 0; column < 3; ++column) {
            const auto& zone = spread.zones[3 * row + column];
            cells.push_back(zone ? fmt::format("{:.3f} ± {:.3f} px ({} edges)", zone->sigma_px,
                                               2.0 * zone->standard_uncertainty_px, zone->edges)
                                 : "too few edges");
        }
        rows.push_back(cells);
    }
    page.add_paragraph(
        "Sigma of the Gaussian, U with k = 2. The camera file has one point spread for "
        "the whole image: differences between the zones are what it cannot describe.");
    page.add_table({"", "left", "centre", "right"}, rows);
}

// A disk of radius R has sigma R/2 along a line: beside a Gaussian sqrt(sigma^2 + R^2/4).
std::optional<HtmlPage::Figure> defocus_plot(const Characterisation& result) {
    if (!result.defocus || result.blur_by_depth.empty())
        return std::nullopt;
    const DefocusEstimate& defocus = *result.defocus;
    CameraModel focused = result.camera;
    focused.lens = Lens{defocus.f_number, defocus.focus_distance_mm, 550.0, {}};
    Series groups, curve;
    for (const BlurAtDepth& at : result.blur_by_depth)
        groups.add(at.depth_mm, at.sigma_px);
    for (int i = 0; i <= 100; ++i) {
        const double depth = groups.xs.front() + (groups.xs.back() - groups.xs.front()) * i / 100.0;
        curve.add(depth, std::hypot(defocus.sigma_px, 0.5 * blur_radius_px(focused, depth)));
    }
    SvgPlot plot("depth, mm", "standard deviation of the blur, px");
    plot.add_line(curve, Color::red, "thin lens fitted");
    plot.add_points(groups, Color::blue, "groups of edges");
    return HtmlPage::Figure{
        plot.svg(), fmt::format("Blur against depth: {} edges nearer than focus, {} farther. The "
                                "groups are for the eye, the fit is on every edge's pixels: look "
                                "whether they lie on it on both sides of focus.",
                                defocus.edges_nearer, defocus.edges_farther)};
}

void add_curves(HtmlPage& page, const Characterisation& result) {
    HtmlPage::Figures sensor, lens;
    if (result.photon_transfer)
        sensor.push_back(photon_transfer_plot(*result.photon_transfer));
    if (result.transfer)
        sensor.insert(sensor.end(),
                      {transfer_plot(*result.transfer), nonlinearity_plot(*result.transfer)});
    if (!sensor.empty()) {
        page.add_heading("Sensor");
        page.add_figures(sensor);
    }
    if (result.illumination) {
        page.add_heading("Relative illumination");
        page.add_figures({illumination_plot(result.camera, *result.illumination),
                          illumination_map(result.camera, *result.illumination)});
    }
    if (!result.modulation.empty())
        lens.push_back(modulation_plot(result));
    if (result.point_spread)
        lens.push_back(edge_spread_plot(*result.point_spread));
    if (auto defocus = defocus_plot(result))
        lens.push_back(*std::move(defocus));
    if (!lens.empty()) {
        page.add_heading("Lens");
        page.add_figures(lens);
    }
    if (result.point_spread)
        add_zones(page, *result.point_spread);
}

}  // namespace

std::string with_uncertainty(const MeasuredValue& value) {
    const double expanded = 2.0 * value.standard_uncertainty;
    const int decimals = decimals_of(expanded);
    const std::string unit = value.unit.empty() ? "" : " " + value.unit;
    return fmt::format("{} {} +- {}{}", value.words, fixed(value.value, decimals),
                       fixed(expanded, decimals), unit);
}

void write_characterise_report(const std::filesystem::path& folder, const CharacteriseInput& input,
                               const Characterisation& result) {
    const FolderLock lock = claim_folder(folder);
    const std::string serial = input.camera.serial.empty() ? "" : " " + input.camera.serial;
    HtmlPage page(
        "Camera" + serial + " characterised",
        fmt::format("{} x {} px, {} bit; target {}, found in {} of {} photos", input.camera.width,
                    input.camera.height, result.camera.sensor->bits, input.target.board.spec,
                    result.photos_with_target, input.photos.size()));
    add_summary(page, result);
    add_values(page, result);
    add_curves(page, result);
    write_text(folder / "report.html", page.finish());
}

int run_characterise(const CharacteriseArguments& given) {
    const PhotoFiles files(given.photos);
    CharacteriseArguments arguments = given;
    arguments.photos = files.paths();
    if (!arguments.edge.empty())
        return run_edge(arguments);
    for (const auto& [option, is_missing] : {std::pair("--camera", arguments.camera.empty()),
                                             {"--target", arguments.target.empty()},
                                             {"--out", arguments.out.empty()}})
        if (is_missing)
            throw ConfigError({option}, "is required, unless with --edge");
    const CharacteriseInput input = read_input(arguments);
    const Characterisation result = characterise(input);
    for (const std::string& remark : result.remarks)
        print_stderr("{}\n", remark);
    write_camera(arguments.out, result.camera);
    if (!arguments.report.empty())
        write_characterise_report(arguments.report, input, result);
    if (arguments.json) {
        print_json(arguments, result);
    } else {
        print_words(result);
        fmt::print("camera {}\n", arguments.out.string());
        print_report(arguments.report);
    }
    return result.was_anything_refused() ? ExitCode::inconclusive : 0;
}

void declare_characterise(Command& program) {
    auto [command, asked] = program.add(run_characterise, "characterise",
                                        "measure blur, noise, tone and illumination of a camera",
                                        characterise_help_txt);
    command.option("PHOTOS", asked->photos, "the target in several places and tilts");
    command.option("--camera", asked->camera, "calibration: ours or another tool's", "FILE");
    command.option("--target", asked->target, "the target, as for calibrating", "M");
    command.option("--repeats", asked->repeats, "one still view, two or more times", "PHOTOS");
    command.option("--flat", asked->flats, "a uniform field", "PHOTOS");
    command.option("--dark", asked->darks, "lens covered", "PHOTOS");
    command.option("--exposures", asked->exposures,
                   "CSV file,exposure_us: one still scene at\nseveral exposure times", "FILE");
    command.option("--out", asked->out, "camera.yml to write", "FILE");
    command.option(
        "--edge", asked->edge,
        "only the MTF, along slanted edges of any\nphotographs: auto finds them, or X,Y,WxH in px",
        "WHERE");
    command.option("--report", asked->report, "folder for report.html", "DIR");
}

}  // namespace etalon
