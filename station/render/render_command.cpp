// `etalon render`: markers as a calibrated camera would see them, one image.
#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "core/errors.h"
#include "sim/scene/pose_file.h"
#include "station/render/render_plan_text.h"
#include "station/render/render_view.h"
#include "station/shell/commands.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

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

std::vector<Rigid> read_placement(const RenderArguments& arguments) {
    if (arguments.poses.size() != arguments.markers.size())
        throw ConfigError({"--pose"},
                          fmt::format("{} for {} markers: each needs one, or --poses a file",
                                      arguments.poses.size(), arguments.markers.size()));
    std::vector<Rigid> camera_from_marker;
    for (const std::string& pose : arguments.poses)
        camera_from_marker.push_back(parse_pose(pose, "--pose"));
    return camera_from_marker;
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

ordered_json markers_json(const RenderArguments& arguments,
                          const std::vector<Rigid>& camera_from_marker) {
    ordered_json markers = ordered_json::array();
    for (std::size_t i = 0; i < camera_from_marker.size(); ++i) {
        const Vector6d v = vector_from_rigid(camera_from_marker[i]);
        markers.push_back({{"marker", arguments.markers[i]},
                           {"camera_from_marker", std::vector<double>(v.data(), v.data() + 6)}});
    }
    return markers;
}

void print_json(const RenderArguments& arguments, const CameraModel& camera,
                const std::vector<Rigid>& camera_from_marker, const View& view) {
    ordered_json json = {
        {"etalon", "render/1"},
        {"file", arguments.out.string()},
        {"camera", arguments.camera.string()},
        {"markers", markers_json(arguments, camera_from_marker)},
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
    if (arguments.noise_seed)
        json["noise_seed"] = *arguments.noise_seed;
    if (view.plan) {
        json["plan"] = ordered_json::parse(plan_json(*view.plan));
        json["pixels_without_ray"] = view.pixels_without_ray;
    } else {
        json["largest_standard_error_gray"] = view.standard_error_gray;
    }
    fmt::print("{}\n", json.dump(2, ' ', false, ordered_json::error_handler_t::replace));
}

void print_summary(const RenderArguments& arguments, const View& view, double seconds) {
    fmt::print(stderr, "{}: {} ({:.2f} s)\n", arguments.out.string(), view.describe(), seconds);
    if (view.pixels_without_ray > 0)
        fmt::print(stderr,
                   "{} pixels have no ray (the distortion model ends before them): they "
                   "show the background\n",
                   view.pixels_without_ray);
}

int render_one(const RenderArguments& arguments) {
    check_output(arguments);
    const std::vector<Rigid> camera_from_marker = read_placement(arguments);
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

}  // namespace

int run_render(const RenderArguments& arguments) {
    return arguments.pose_file.empty() ? render_one(arguments) : run_render_set(arguments);
}

}  // namespace etalon
