// `etalon marker`: a marker in its true size, ready to print.
#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "report/json_text.h"
#include "sim/marker/marker_print.h"
#include "station/render/commands.h"
#include "station/shell/command.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

// Where the marker's points are, in the marker frame: what somebody else's software has to know
// about the print.
ordered_json marker_json(const Marker& marker, const PrintPage& page,
                         const MarkerArguments& arguments) {
    ordered_json json = {{"etalon", "marker/1"},
                         {"marker", marker.spec},
                         {"file", arguments.out.string()},
                         {"page_mm", {page.width_mm, page.height_mm}},
                         {"scale_bar_mm", page.scale_bar_mm.width},
                         {"cells", {marker.grid.columns(), marker.grid.rows()}},
                         {"cell_mm", {marker.grid.cell_mm.x(), marker.grid.cell_mm.y()}},
                         {"points_mm", ordered_json::array()}};
    for (const Eigen::Vector3d& point : marker.points_mm)
        json["points_mm"].push_back({point.x(), point.y(), point.z()});
    return json;
}

}  // namespace

int run_marker(const MarkerArguments& arguments) {
    const Marker marker = parse_marker(arguments.marker, "MARKER");
    const PrintPage page = print_marker(marker, arguments.out, arguments.dots_per_mm);
    fmt::print(stderr, "{}: {:.6g} x {:.6g} mm; the bar must measure {} mm when printed\n",
               arguments.out.string(), page.width_mm, page.height_mm, page.scale_bar_mm.width);
    if (arguments.json)
        fmt::print("{}\n", text_of(marker_json(marker, page, arguments)));
    return 0;
}

void declare_marker(Command& program) {
    auto [command, asked] = program.add(
        run_marker, "marker", "draw a marker at its true size, ready to print", marker_help);
    command.required("MARKER", asked->marker, "what to draw, see below");
    command.required("--out", asked->out, "file to write: .svg, .pdf or .png", "FILE");
    command.option("--dots-per-mm", asked->dots_per_mm, "resolution of a PNG (default 40)", "N")
        .positive();
}

}  // namespace etalon
