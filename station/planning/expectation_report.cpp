#include "station/planning/expectation_report.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/geometry/units.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "report/svg_plot.h"

namespace etalon {
namespace {

double rms(const std::vector<double>& values) {
    double sum = 0.0;
    for (const double value : values)
        sum += value * value / static_cast<double>(values.size());
    return std::sqrt(sum);
}

const MarkerPlace& worst_place(const Expectation& expectation, std::size_t component) {
    std::vector<const MarkerPlace*> mapped;
    for (const ExpectedPose& pose : expectation.poses)
        if (pose.bias)
            mapped.push_back(&pose.place);
    return *mapped[(*expectation.bias_maps)[component].worst()];
}

constexpr int plot_width = 420, plot_height = 320;  // three beside each other stay readable

struct Abscissa {
    double MarkerPlace::*variable;
    const char* label;
    double unit;  // of the map per unit of the plot
};
const std::array<Abscissa, 3> abscissae = {{
    {&MarkerPlace::depth_mm, "depth, mm", 1.0},
    {&MarkerPlace::radius_px, "distance from the principal point, px", 1.0},
    {&MarkerPlace::tilt_rad, "tilt, deg", 1.0 / deg_per_rad},
}};

// What is drawn of each pose: the values, their maps and how a map's value is shown.
struct Ordinate {
    const char* label;
    Expectation::Six of_pose;
    std::optional<std::array<ExpectationMap, 6>> Expectation::*maps;
    double (*shown)(double);
    Color color;
};
const Ordinate bias_ordinate{"B1", &ExpectedPose::bias, &Expectation::bias_maps,
                             [](double value) { return value; }, Color::blue};
const Ordinate noise_ordinate{"noise", &ExpectedPose::noise, &Expectation::noise_maps,
                              [](double value) { return std::exp(value); }, Color::orange};

// Each pose, and the map's average over the other two variables as a line with its 95 % band.
std::string component_plot(const Expectation& expectation, const Ordinate& what,
                           std::size_t component, const Abscissa& along) {
    constexpr int steps = 30;
    const MeasureName& named = error_components[component];
    SvgPlot plot(along.label, fmt::format("{} {}, {}", what.label, named.name, named.unit),
                 plot_width, plot_height);
    std::vector<double> xs;
    for (const ExpectedPose& pose : expectation.poses)
        if (pose.*what.of_pose)
            xs.push_back(pose.place.*along.variable / along.unit);
    plot.add_points({xs, expectation.values(what.of_pose, component)}, Color::gray, "pose");
    const auto [low, high] = std::ranges::minmax(xs);
    Series series;
    for (int i = 0; i <= steps; ++i) {
        const double at = low + (high - low) * i / steps;
        const MapValue average =
            (*(expectation.*what.maps))[component].average_at(along.variable, at * along.unit);
        series.add(at, what.shown(average.value), what.shown(average.low),
                   what.shown(average.high));
    }
    plot.add_band(series, what.color, "95 %");
    plot.add_line(series, what.color, "average");
    return plot.svg();
}

void add_bias_plots_of(HtmlPage& page, const Expectation& expectation, std::size_t component) {
    HtmlPage::Figures figures;
    for (const Abscissa& along : abscissae)
        figures.push_back({component_plot(expectation, bias_ordinate, component, along),
                           fmt::format("Bias {}: each pose, and the smooth map averaged over the "
                                       "other two variables. A line that leaves zero can be "
                                       "corrected, the scatter about it cannot.",
                                       error_components[component].name)});
    page.add_figures(figures);
}

void add_plots(HtmlPage& page, const Expectation& expectation) {
    for (const std::size_t component : {std::size_t{0}, std::size_t{1}, std::size_t{4}})
        add_bias_plots_of(page, expectation, component);
    if (!expectation.noise_maps)
        return;
    HtmlPage::Figures figures;
    for (const std::size_t component : {std::size_t{0}, std::size_t{4}})
        for (const Abscissa& along : abscissae)
            figures.push_back({component_plot(expectation, noise_ordinate, component, along),
                               fmt::format("Noise {}: standard deviation of a single frame. Where "
                                           "the line rises, average frames or stay nearer.",
                                           error_components[component].name)});
    page.add_figures(figures);
}

Json value_json(const MapValue& value) {
    return {{"value", value.value}, {"low_95", value.low}, {"high_95", value.high}};
}

const ColumnsOf<MarkerPlace> place_columns = {
    {"depth_mm", &MarkerPlace::depth_mm},
    {"radius_px", &MarkerPlace::radius_px},
    {"tilt_deg", [](const MarkerPlace& at) { return at.tilt_rad * deg_per_rad; }}};

Json place_json(const MarkerPlace& place) {
    return json_object(table_of_one(place_columns, place));
}

Json component_json(const Expectation& expectation, std::size_t k) {
    const std::vector<double> biases = expectation.values(&ExpectedPose::bias, k);
    const std::vector<double> noises = expectation.values(&ExpectedPose::noise, k);
    Json json = {{"name", error_components[k].name}, {"unit", error_components[k].unit}};
    if (!biases.empty())
        json["bias_rms"] = rms(biases);
    if (expectation.bias_maps) {
        const ExpectationMap& map = (*expectation.bias_maps)[k];
        const MarkerPlace& worst = worst_place(expectation, k);
        json["bias_mean"] = value_json(map.mean());
        json["bias_scatter_about_map"] = map.scatter();
        json["worst"] = place_json(worst);
        json["worst"]["bias"] = value_json(map.at(worst));
    }
    json["noise_rms"] = noises.empty() ? Json() : Json(rms(noises));
    return json;
}

Json pose_json(const ExpectedPose& pose) {
    return {{"camera_from_marker", pose_numbers(pose.camera_from_marker)},
            {"place", place_json(pose.place)},
            {"bias", or_null(pose.bias)},
            {"noise", or_null(pose.noise)},
            {"detections", pose.detections},
            {"flips", pose.flips}};
}

std::vector<std::string> summary_header() {
    return {"component", "unit", "mean", "95 %", "RMS", "scatter", "worst", "at", "noise"};
}

ColumnsOf<SixErrors> six_columns() {
    ColumnsOf<SixErrors> columns;
    for (std::size_t k = 0; const char* key : {"sight_mm", "outwards_mm", "around_mm", "turn_mrad",
                                               "tilt_mrad", "across_mrad"})
        columns.push_back({key, [k = k++](const SixErrors& six) { return six[k]; }});
    return columns;
}

}  // namespace

std::vector<std::vector<std::string>> summary_rows(const Expectation& expectation) {
    std::vector<std::vector<std::string>> rows;
    for (std::size_t k = 0; k < 6; ++k) {
        const std::vector<double> noises = expectation.values(&ExpectedPose::noise, k);
        std::vector<std::string> row = {error_components[k].name, error_components[k].unit};
        if (expectation.bias_maps) {
            const ExpectationMap& map = (*expectation.bias_maps)[k];
            const MapValue mean = map.mean();
            const MarkerPlace& worst = worst_place(expectation, k);
            row.insert(row.end(),
                       {fixed(mean.value, 4), fmt::format("{:.4f} .. {:.4f}", mean.low, mean.high),
                        fixed(rms(expectation.values(&ExpectedPose::bias, k)), 4),
                        fixed(map.scatter(), 4), fixed(map.at(worst).value, 4),
                        fmt::format("{:.0f} mm, {:.0f} px, {:.0f} deg", worst.depth_mm,
                                    worst.radius_px, worst.tilt_rad * deg_per_rad)});
        } else {
            row.resize(8);
        }
        row.push_back(noises.empty() ? "unknown" : fixed(rms(noises), 4));
        rows.push_back(row);
    }
    return rows;
}

void add_expectation(HtmlPage& page, const Expectation& expectation) {
    const auto bias_rms = [&](std::size_t k) {
        return rms(expectation.values(&ExpectedPose::bias, k));
    };
    if (expectation.bias_maps)
        page.add_verdict(fmt::format("{} mm", significant(bias_rms(0), 2)),
                         fmt::format("is the bias along the line of sight, RMS over the volume; "
                                     "across it {} mm.",
                                     significant(std::hypot(bias_rms(1), bias_rms(2)), 2)));
    else
        page.add_verdict(fmt::format("{} of {}", expectation.detected(), expectation.poses.size()),
                         fmt::format("poses were detected, too few for a map: {} are needed.",
                                     ExpectationMap::min_poses));
    page.add_paragraph(fmt::format(
        "Marker detected at {} of {} poses without noise, and in {:.1f} % of all frames; the other "
        "planar solution fitted better in {:.1f} % of the frames with noise.{}",
        expectation.detected(), expectation.poses.size(), 100.0 * expectation.detection_rate(),
        100.0 * expectation.flip_rate(),
        expectation.no_noise.empty() ? "" : " No noise: " + expectation.no_noise + "."));
    if (!expectation.bias_maps)
        return;
    page.add_table(summary_header(), summary_rows(expectation));
    page.add_notes(
        {"Bias is B1: the pose that the detector finds in a render, less the pose that was "
         "rendered. Scatter is that of the poses about the smooth map; worst is where the "
         "map is largest, at this depth, distance from the principal point and tilt."});
    add_plots(page, expectation);
}

void add_short_expectation(HtmlPage& page, const Expectation& expectation) {
    if (!expectation.bias_maps)
        return;
    page.add_table(summary_header(), summary_rows(expectation));
    add_bias_plots_of(page, expectation, 0);
}

std::string expectation_json(const ExpectationRequest& request, const Expectation& expectation) {
    Json json = {{"etalon", "expectation/1"},
                 {"marker", request.scene.marker.spec},
                 {"detector", request.scene.detector},
                 {"volume",
                  {{"nearest_mm", request.volume.nearest_mm},
                   {"farthest_mm", request.volume.farthest_mm},
                   {"max_tilt_deg", request.volume.max_tilt * deg_per_rad}}},
                 {"background", request.scene.background},
                 {"white_level", request.scene.white_level},
                 {"seed", request.seed},
                 {"poses", expectation.poses.size()},
                 {"frames_per_pose", expectation.frames},
                 {"no_noise", expectation.no_noise},
                 {"detected", expectation.detected()},
                 {"detection_rate", expectation.detection_rate()},
                 {"flip_rate", expectation.flip_rate()}};
    for (std::size_t k = 0; k < 6; ++k)
        json["components"].push_back(component_json(expectation, k));
    json["pose_list"] = json_list(expectation.poses, pose_json);
    return text_of(json) + "\n";
}

std::string expectation_csv(const Expectation& expectation) {
    ColumnsOf<ExpectedPose> columns;
    add_columns(columns, columns_of_pose(), &ExpectedPose::camera_from_marker);
    add_columns(columns, place_columns, &ExpectedPose::place);
    columns.push_back({"detections", &ExpectedPose::detections});
    columns.push_back({"flips", &ExpectedPose::flips});
    add_columns(columns, six_columns(), &ExpectedPose::bias, "bias_");
    add_columns(columns, six_columns(), &ExpectedPose::noise, "noise_");
    return csv_of(table_of(columns, expectation.poses));
}

void write_expectation(const ExpectationRequest& request, const Expectation& expectation,
                       const std::filesystem::path& folder) {
    const FolderLock lock = claim_folder(folder);
    HtmlPage page("Expected pose errors", request.scene.marker.spec);
    add_expectation(page, expectation);
    page.add_facts(
        {{"marker", request.scene.marker.spec},
         {"detector", request.scene.detector},
         {"image",
          fmt::format("{} x {} px", request.scene.camera.width, request.scene.camera.height)},
         {"depth",
          fmt::format("{:g} to {:g} mm", request.volume.nearest_mm, request.volume.farthest_mm)},
         {"tilt", fmt::format("up to {:.0f} deg", request.volume.max_tilt * deg_per_rad)},
         {"poses", std::to_string(expectation.poses.size())},
         {"frames with noise, each", std::to_string(expectation.frames)}});
    write_text(folder / "report.html", page.finish());
    write_text(folder / "expectation.json", expectation_json(request, expectation));
    write_text(folder / "poses.csv", expectation_csv(expectation));
}

}  // namespace etalon
