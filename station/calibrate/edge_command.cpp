// `etalon characterise --edge`: the modulation transfer along slanted edges of any photograph.
#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "compare/photo_pose.h"
#include "core/file/file_writing.h"
#include "core/file/text.h"
#include "core/program/print_stderr.h"
#include "report/html.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "report/svg_plot.h"
#include "station/calibrate/commands.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

struct PhotoEdge {
    std::filesystem::path photo;
    cv::Rect region;
    SlantedEdge edge;
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

std::string mtf50_of(const PhotoEdge& one) {
    return with_u(one.edge.mtf50_cycles_per_px, one.edge.mtf50_standard_uncertainty);
}

std::string nyquist_of(const PhotoEdge& one) {
    return with_u(one.edge.at_nyquist, one.edge.at_nyquist_standard_uncertainty);
}

std::string place_of(const PhotoEdge& one) {
    const cv::Rect& r = one.region;
    return fmt::format("{},{},{}x{}", r.x, r.y, r.width, r.height);
}

Json edge_json(const PhotoEdge& one) {
    const SlantedEdge& edge = one.edge;
    return {{"photo", one.photo.string()},
            {"region_px", {one.region.x, one.region.y, one.region.width, one.region.height}},
            {"angle_deg", edge.angle_deg},
            {"mtf50_cycles_per_px", edge.mtf50_cycles_per_px},
            {"mtf50_standard_uncertainty", edge.mtf50_standard_uncertainty},
            {"at_nyquist", edge.at_nyquist},
            {"at_nyquist_standard_uncertainty", edge.at_nyquist_standard_uncertainty},
            {"rows", json_list(edge.modulation, [](const ModulationRow& row) {
                 return Json{row.cycles_per_px, row.modulation, row.standard_uncertainty};
             })}};
}

std::string edges_csv(const std::vector<PhotoEdge>& edges) {
    std::string text = "photo,region_px,cycles_per_px,modulation,standard_uncertainty\n";
    for (const PhotoEdge& one : edges)
        for (const ModulationRow& row : one.edge.modulation)
            text += fmt::format("{},{},{},{},{}\n", csv_text(one.photo.string()),
                                csv_text(place_of(one)), exact(row.cycles_per_px),
                                exact(row.modulation), exact(row.standard_uncertainty));
    return text;
}

HtmlPage::Figure curve_of(const PhotoEdge& one) {
    SvgPlot plot("spatial frequency, cycles per px", "modulation");
    plot.set_y_range(0.0, 1.2);
    Series curve;
    for (const ModulationRow& row : one.edge.modulation)
        curve.add(row.cycles_per_px, row.modulation,
                  row.modulation - 2.0 * row.standard_uncertainty,
                  row.modulation + 2.0 * row.standard_uncertainty);
    plot.add_band(curve, Color::blue, "U (k = 2)");
    plot.add_line(curve, Color::blue, "modulation");
    return {plot.svg(),
            fmt::format("{}, {}: {:.1f} degrees from the pixels' axis. A curve above 1 tells of "
                        "sharpening.",
                        one.photo.filename().string(), place_of(one), one.edge.angle_deg)};
}

std::string edges_page(const std::vector<PhotoEdge>& edges) {
    HtmlPage page("Slanted edges", "spatial frequency response, ISO 12233");
    HtmlPage::Figures figures;
    std::vector<double> mtf50;
    for (const PhotoEdge& one : edges) {
        figures.push_back(curve_of(one));
        mtf50.push_back(one.edge.mtf50_cycles_per_px);
    }
    const auto [low, high] = std::ranges::minmax(mtf50);
    page.add_verdict(fmt::format("{:.3f} to {:.3f}", low, high),
                     fmt::format("cycles per px is where the modulation has fallen to one half "
                                 "(MTF50), over {}.",
                                 counted(mtf50.size(), "edge")));
    const ColumnsOf<PhotoEdge> columns = {
        {"", [](const PhotoEdge& one) { return one.photo.filename().string(); }, "photo"},
        {"", place_of, "region", "px"},
        {"", [](const PhotoEdge& one) { return one.edge.angle_deg; }, "angle", "deg", "{:.1f}"},
        {"", mtf50_of, "MTF50", "cycles per px"},
        {"", nyquist_of, "at Nyquist"}};
    page.add_table(table_of(columns, edges));
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
        print_stderr(
            "no camera file: pixel values are taken to be linear in light, which those of "
            "JPEG files\nare not\n");
    std::vector<PhotoEdge> edges;
    for (const auto& path : arguments.photos)
        for (FoundSlantedEdge& found : edges_in(path, linear(path, arguments), region))
            edges.push_back({path, found.region, std::move(found.edge)});
    if (!arguments.report.empty()) {
        const FolderLock lock = claim_folder(arguments.report);
        write_text(arguments.report / "edges.csv", edges_csv(edges));
        write_text(arguments.report / "report.html", edges_page(edges));
    }
    if (arguments.json) {
        std::puts(text_of({{"etalon", "edges/1"}, {"edges", json_list(edges, edge_json)}}).c_str());
        return 0;
    }
    for (const PhotoEdge& one : edges)
        fmt::print("MTF50 {} cycles/px at {}, {:.1f} deg, Nyquist {}: {}\n", mtf50_of(one),
                   place_of(one), one.edge.angle_deg, nyquist_of(one),
                   one.photo.filename().string());
    print_report(arguments.report);
    return 0;
}

}  // namespace etalon
