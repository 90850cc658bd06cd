// `etalon render`: markers as a calibrated camera would see them, one image.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "core/program/errors.h"
#include "core/program/print_stderr.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "sim/marker/marker_print.h"
#include "station/render/image_set.h"
#include "station/render/render_view.h"
#include "station/shell/command.h"
#include "station/shell/signals.h"

namespace etalon {
namespace {

void check_output(const RenderArguments& arguments) {
    const std::string extension = arguments.out.extension().string();
    const bool tiff = extension == ".tif" || extension == ".tiff";
    if (arguments.linear && !tiff)
        throw ConfigError({"--out"}, "linear radiance is written to .tif or .tiff, not to '" +
                                         arguments.out.string() + "'");
    if (!tiff && extension != ".png")
        throw ConfigError({"--out"},
                          "'" + arguments.out.string() + "' must end in .png, .tif or .tiff");
}

// Here a marker that cannot be seen is a slip in what was typed.
Scene place_markers(const ViewRenderer& renderer, const RenderArguments& arguments,
                    const std::vector<Rigid>& camera_from_marker) {
    try {
        return renderer.scene(camera_from_marker);
    } catch (const NumericalError& error) {
        throw ConfigError({"--pose"},
                          fmt::format("{}: {}", fmt::join(arguments.poses, " "), error.what()));
    }
}

void print_json(const RenderArguments& arguments, const CameraModel& camera,
                const std::vector<Rigid>& camera_from_marker, const View& view) {
    Json markers = Json::array();
    for (std::size_t i = 0; i < camera_from_marker.size(); ++i)
        markers.push_back({{"marker", arguments.markers[i]},
                           {"camera_from_marker", pose_numbers(camera_from_marker[i])}});
    Json json = {
        {"etalon", "render/1"},
        {"file", arguments.out.string()},
        {"camera", arguments.camera.string()},
        {"markers", markers},
        {"background", arguments.background},
        {"width", camera.width},
        {"height", camera.height},
        {"linear", arguments.linear},
        {"exposure", arguments.exposure},
        {"velocity", arguments.velocity},
        {"shutter_ms", arguments.shutter_ms},
        {"method", view.describe()},
    };
    if (!arguments.linear)
        json["bits"] = camera.sensor ? camera.sensor->bits : 8;
    add_present(json, "noise_seed", arguments.noise_seed);
    add_method(view, json);
    fmt::print("{}\n", text_of(json));
}

void print_summary(const RenderArguments& arguments, const View& view, double seconds) {
    print_stderr("{}: {} ({:.2f} s)\n", arguments.out.string(), view.describe(), seconds);
    if (view.pixels_without_ray > 0)
        print_stderr(
            "{} pixels have no ray (the distortion model ends before them): they "
            "show the background\n",
            view.pixels_without_ray);
}

int render_one(const RenderArguments& arguments) {
    check_output(arguments);
    if (arguments.poses.size() != arguments.markers.size())
        throw ConfigError({"--pose"},
                          fmt::format("{} for {} markers: each needs one, or --poses a file",
                                      arguments.poses.size(), arguments.markers.size()));
    const std::vector<Rigid> camera_from_marker = parse_poses(arguments.poses);
    const ViewRenderer renderer(arguments);
    const Scene scene = place_markers(renderer, arguments, camera_from_marker);
    const auto began = std::chrono::steady_clock::now();
    const View view = renderer.render(scene);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - began;
    renderer.write(arguments.out, view, 0);
    print_summary(arguments, view, seconds.count());
    if (arguments.json)
        print_json(arguments, renderer.camera(), camera_from_marker, view);
    else if (arguments.explain)
        fmt::print("{}", view.plan ? plan_table(*view.plan) : view.describe() + "\n");
    return 0;
}

// `etalon marker`: a marker in its true size, ready to print.

// Where the marker's points are, in the marker frame, for somebody else's software.
Json marker_json(const Marker& marker, const PrintPage& page, const MarkerArguments& arguments) {
    Json json = {{"etalon", "marker/1"},
                 {"marker", marker.spec},
                 {"file", arguments.out.string()},
                 {"page_mm", {page.width_mm, page.height_mm}},
                 {"scale_bar_mm", page.scale_bar_mm.width},
                 {"cells", {marker.grid.columns(), marker.grid.rows()}},
                 {"cell_mm", {marker.grid.cell_mm.x(), marker.grid.cell_mm.y()}},
                 {"points_mm", Json::array()}};
    for (const Eigen::Vector3d& point : marker.points_mm)
        json["points_mm"].push_back({point.x(), point.y(), point.z()});
    return json;
}

struct RenderMergeArguments {
    std::vector<std::filesystem::path> shards;
    std::filesystem::path out;  // of the whole set
    bool json = false;
};

int run_render_merge(const RenderMergeArguments& arguments) {
    const MergedImages merged = merge_image_sets(arguments.shards, arguments.out);
    print_stderr("{}: {} images merged, {} poses refused\n", arguments.out.string(), merged.images,
                 merged.refused);
    if (arguments.json)
        fmt::print("{}\n", text_of(Json{{"etalon", "render-merge/1"},
                                        {"folder", arguments.out.string()},
                                        {"images", merged.images},
                                        {"refused", merged.refused}}));
    return 0;
}

int run_render_set(const RenderArguments& arguments) {
    std::stop_source stop;
    const StopOnSignals signals(stop);
    if (arguments.explain)
        throw ConfigError({"--explain"},
                          "with --poses every image's plan is in the folder's images.jsonl");
    StderrProgress progress;
    const auto began = std::chrono::steady_clock::now();
    const SetResult result = render_set(arguments, stop.get_token(), progress);
    const double seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
    print_stderr("{}: {} images rendered, {} were there, {} poses refused ({:.1f} s)\n",
                 arguments.out.string(), result.rendered, result.already_there, result.refused,
                 seconds);
    if (result.refused > 0)
        print_stderr("{}\nthe reasons are in {}\n", result.first_refusal,
                     (arguments.out / "images.jsonl").string());
    if (!result.complete)
        throw Interrupted();
    if (result.rendered + result.already_there == 0)
        throw ConfigError({arguments.pose_file.string()}, "none of its poses can be rendered");
    if (arguments.json)
        fmt::print("{}\n", text_of({{"etalon", "render-set/1"},
                                    {"folder", arguments.out.string()},
                                    {"rendered", result.rendered},
                                    {"already_there", result.already_there},
                                    {"refused", result.refused},
                                    {"seconds", seconds}}));
    return 0;
}

}  // namespace

int run_render(const RenderArguments& arguments) {
    // `merge` needs none, so that the command line cannot require them.
    for (const auto& [name, is_missing] : {std::pair("--camera", arguments.camera.empty()),
                                           {"--marker", arguments.markers.empty()},
                                           {"--out", arguments.out.empty()}})
        if (is_missing)
            throw ConfigError({}, std::string(name) + " is required");
    if (!arguments.shard.empty() && arguments.pose_file.empty())
        throw ConfigError({"--shard"}, "is of a set: it needs --poses");
    return arguments.pose_file.empty() ? render_one(arguments) : run_render_set(arguments);
}

constexpr const char* render_details =
    "\nSeveral markers: repeat --marker and --pose; one must not hide another.\n\n"
    "With --poses the scene is rendered from every pose of a file (CSV with the\n"
    "header rx,ry,rz,tx,ty,tz, or JSON) into the folder --out, in parallel. A row is\n"
    "the scene's pose; --pose then says where a marker is in the scene and may be\n"
    "left out for one marker. The same command again renders only what is missing;\n"
    "poses that cannot be rendered are listed in images.jsonl and counted.\n\n"
    "Examples:\n"
    "  etalon render --camera camera.yml --marker apriltag:36h11:5@50mm \\\n"
    "      --pose 0.2,-0.1,0,5,7,300 --out render.png\n"
    "  etalon render --camera camera.yml --marker apriltag:36h11:5@50mm \\\n"
    "      --poses poses.csv --out images\n";

void declare_render(Command& program) {
    auto [command, asked] =
        program.add(run_render, "render", "render markers as a calibrated camera would see them",
                    pose_help + "\n" + marker_help + render_details);
    command.option("--camera", asked->camera, "calibration: ours, OpenCV's or ROS'", "FILE");
    command.option("--marker", asked->markers, "what to render, see below", "M").one_each();
    command.option("--pose", asked->poses, "rx,ry,rz,tx,ty,tz: where it is, see below", "P")
        .one_each();
    command.option("--poses", asked->pose_file, "render a set: an image for every pose", "FILE");
    command.option("--shard", asked->shard, "of a set only part I of N: every N-th pose", "I/N");
    command.option("--out", asked->out, ".png or .tiff; of a set: the folder", "FILE");
    command.option("--background", asked->background,
                   "radiance around the markers, 0 to 1 (default 1),\n"
                   "or an image of the camera without them",
                   "B");
    command
        .option("--method", asked->method,
                "auto (default), E (exact lens), C (exact area)\n"
                "or reference (brute force, slow)",
                "NAME")
        .one_of({"auto", "E", "C", "reference"});
    command
        .option("--tolerance", asked->tolerance_gray,
                "largest error, in 1/255 of full scale (default 0.1)", "GRAY")
        .positive();
    command
        .option("--exposure", asked->exposure,
                "factor on the radiance, background included\n(default 1)", "X")
        .positive();
    command.option("--velocity", asked->velocity,
                   "motion blur: rad/s and mm/s of the markers\n"
                   "in the camera's frame; with --shutter",
                   "WX,WY,WZ,VX,VY,VZ");
    command.option("--shutter", asked->shutter_ms, "how long the shutter is open", "MS").positive();
    command.flag("--linear", asked->linear, "write radiance as 32-bit float TIFF");
    command
        .option("--noise-seed", asked->noise_seed,
                "add the sensor's shot and read noise, from this seed", "N")
        .whole();
    command.flag("--explain", asked->explain, "print what was left out, and by which bound");
    auto [merge, merged] = command.add(
        run_render_merge, "merge", "put the shards of an image set together",
        "All shards, in any order. The set is that of one piece, byte for byte; images\n"
        "are linked where the disk allows it.\n\n"
        "Example:\n  etalon render merge part-1 part-2 part-3 --out images\n");
    merge.required("SHARDS", merged->shards, "folders of `etalon render --shard`");
    merge.required("--out", merged->out, "folder of the whole set", "DIR");
}

int run_marker(const MarkerArguments& arguments) {
    const Marker marker = parse_marker(arguments.marker, "MARKER");
    const PrintPage page = print_marker(marker, arguments.out, arguments.dots_per_mm);
    print_stderr("{}: {:.6g} x {:.6g} mm; the bar must measure {} mm when printed\n",
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
