// `etalon characterise --edge`: the modulation transfer along slanted edges of any photograph.
#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "compare/characterise/slanted_edge.h"
#include "compare/photo_pose.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "report/csv.h"
#include "report/html.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "report/svg_plot.h"
#include "station/calibrate/commands.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

struct PhotoEdges {
    std::filesystem::path photo;
    std::vector<FoundSlantedEdge> edges;
};

// "auto": nothing; "400,300,60x90": upper left pixel, columns x rows.
std::optional<cv::Rect> region_of(const std::string& where) {
    if (where == "auto")
        return std::nullopt;
    const std::vector<std::string> parts = split(where, ',');
    const std::vector<std::string> sides =
        parts.size() == 3 ? split(parts[2], 'x') : std::vector<std::string>();
    if (sides.size() == 2) {
        const auto x = parse_integer(parts[0]), y = parse_integer(parts[1]),
                   width = parse_integer(sides[0]), height = parse_integer(sides[1]);
        if (x && y && width && height)
            return cv::Rect(static_cast<int>(*x), static_cast<int>(*y), static_cast<int>(*width),
                            static_cast<int>(*height));
    }
    throw ConfigError({"--edge"}, "'" + where + "' is neither auto nor X,Y,WxH in px");
}

LinearPhoto linear(const std::filesystem::path& photo, const CharacteriseArguments& arguments) {
    if (!arguments.camera.empty()) {
        const CameraModel camera = read_camera_for(arguments.camera, {photo});
        return linear_photo(read_photo(photo, camera, arguments.camera), camera);
    }
    const CodeImage image = read_image(photo);
    CameraModel camera;
    camera.width = image.pixels.cols;
    camera.height = image.pixels.rows;
    return linear_photo(image, camera);
}

std::vector<FoundSlantedEdge> edges_in(const std::filesystem::path& path, const LinearPhoto& photo,
                                       const std::optional<cv::Rect>& region) {
    if (region)
        return {{*region, slanted_edge(photo, *region)}};
    SlantedEdges found = find_slanted_edges(photo);
    if (found.edges.empty())
        throw NumericalError(
            path.string() + ": " +
            (found.reason.empty()
                 ? "no slanted edge found: a straight edge 2 to 15 degrees off the pixels' rows or "
                   "columns, 24 px or longer, is needed"
                 : "no edge can be measured; the longest one: " + found.reason));
    return std::move(found.edges);
}

std::string with_u(double value, double standard_uncertainty) {
    const double u = 2.0 * standard_uncertainty;
    const int decimals = u > 0.0 ? decimals_of(u) : 4;
    return fmt::format("{} +- {}", fixed(value, decimals), fixed(u, decimals));
}

std::string place_of(const cv::Rect& r) {
    return fmt::format("{},{},{}x{}", r.x, r.y, r.width, r.height);
}

void print_words(const PhotoEdges& all) {
    for (const FoundSlantedEdge& each : all.edges)
        fmt::print("MTF50 {} cycles/px at {}, {:.1f} deg, Nyquist {}: {}\n",
                   with_u(each.edge.mtf50_cycles_per_px, each.edge.mtf50_standard_uncertainty),
                   place_of(each.region), each.edge.angle_deg,
                   with_u(each.edge.at_nyquist, each.edge.at_nyquist_standard_uncertainty),
                   all.photo.filename().string());
}

ordered_json edge_json(const std::filesystem::path& photo, const FoundSlantedEdge& each) {
    const SlantedEdge& edge = each.edge;
    return {{"photo", photo.string()},
            {"region_px", {each.region.x, each.region.y, each.region.width, each.region.height}},
            {"angle_deg", edge.angle_deg},
            {"mtf50_cycles_per_px", edge.mtf50_cycles_per_px},
            {"mtf50_standard_uncertainty", edge.mtf50_standard_uncertainty},
            {"at_nyquist", edge.at_nyquist},
            {"at_nyquist_standard_uncertainty", edge.at_nyquist_standard_uncertainty},
            {"rows", json_list(edge.modulation, [](const ModulationRow& row) {
                 return ordered_json{row.cycles_per_px, row.modulation, row.standard_uncertainty};
             })}};
}

void print_json(const std::vector<PhotoEdges>& photos) {
    ordered_json edges = ordered_json::array();
    for (const PhotoEdges& all : photos)
        for (const FoundSlantedEdge& each : all.edges)
            edges.push_back(edge_json(all.photo, each));
    std::puts(text_of(ordered_json{{"etalon", "edges/1"}, {"edges", edges}}).c_str());
}

std::string csv_of(const std::vector<PhotoEdges>& photos) {
    CsvTable table;
    for (const PhotoEdges& all : photos)
        for (const FoundSlantedEdge& each : all.edges)
            for (const ModulationRow& row : each.edge.modulation) {
                table.text("photo", all.photo.string());
                table.text("region_px", place_of(each.region));
                table.number("cycles_per_px", row.cycles_per_px);
                table.number("modulation", row.modulation);
                table.number("standard_uncertainty", row.standard_uncertainty);
                table.end_row();
            }
    return table.finish();
}

HtmlPage::Figure curve_of(const std::filesystem::path& photo, const FoundSlantedEdge& each) {
    SvgPlot plot("spatial frequency, cycles per px", "modulation");
    plot.set_y_range(0.0, 1.2);
    Series curve;
    for (const ModulationRow& row : each.edge.modulation)
        curve.add(row.cycles_per_px, row.modulation,
                  row.modulation - 2.0 * row.standard_uncertainty,
                  row.modulation + 2.0 * row.standard_uncertainty);
    plot.add_band(curve, Color::blue, "U (k = 2)");
    plot.add_line(curve, Color::blue, "modulation");
    return {plot.svg(),
            fmt::format("{}, {}: {:.1f} degrees from the pixels' axis. A curve above 1 tells of "
                        "sharpening.",
                        photo.filename().string(), place_of(each.region), each.edge.angle_deg)};
}

std::string page_of(const std::vector<PhotoEdges>& photos) {
    HtmlPage page("Slanted edges", "spatial frequency response, ISO 12233");
    TableRows rows;
    HtmlPage::Figures figures;
    std::vector<double> mtf50;
    for (const PhotoEdges& all : photos)
        for (const FoundSlantedEdge& each : all.edges) {
            const SlantedEdge& edge = each.edge;
            rows.push_back({all.photo.filename().string(), place_of(each.region),
                            fixed(edge.angle_deg, 1),
                            with_u(edge.mtf50_cycles_per_px, edge.mtf50_standard_uncertainty),
                            with_u(edge.at_nyquist, edge.at_nyquist_standard_uncertainty)});
            figures.push_back(curve_of(all.photo, each));
            mtf50.push_back(edge.mtf50_cycles_per_px);
        }
    if (!mtf50.empty()) {
        const auto [low, high] = std::ranges::minmax(mtf50);
        page.add_verdict(fmt::format("{:.3f} to {:.3f}", low, high),
                         fmt::format("cycles per px is where the modulation has fallen to one half "
                                     "(MTF50), over {}.",
                                     counted(mtf50.size(), "edge")));
    }
    page.add_table({"photo", "region / px", "angle / deg", "MTF50 / cycles per px", "at Nyquist"},
                   rows);
    page.add_notes(
        {"Lens, pixel and what the camera did to the picture, together. U (k = 2) is that "
         "of the pixels' noise."});
    page.add_figures(figures);
    return page.finish();
}

}  // namespace

int run_edge(const CharacteriseArguments& arguments) {
    const std::optional<cv::Rect> region = region_of(arguments.edge);
    if (arguments.photos.empty())
        throw ConfigError({"PHOTOS"}, "no photograph given");
    if (arguments.camera.empty())
        fmt::print(stderr,
                   "no camera file: pixel values are taken to be linear in light, which those of "
                   "JPEG files\nare not\n");
    std::vector<PhotoEdges> photos;
    for (const auto& path : arguments.photos)
        photos.push_back({path, edges_in(path, linear(path, arguments), region)});
    if (!arguments.report.empty()) {
        make_folder(arguments.report);
        write_text(arguments.report / "edges.csv", csv_of(photos));
        write_text(arguments.report / "report.html", page_of(photos));
    }
    if (arguments.json) {
        print_json(photos);
        return 0;
    }
    for (const PhotoEdges& all : photos)
        print_words(all);
    print_report(arguments.report);
    return 0;
}

}  // namespace etalon
