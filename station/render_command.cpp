// `etalon render`: a marker as a calibrated camera would see it.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "calib/camera_file.h"
#include "core/errors.h"
#include "sim/marker.h"
#include "sim/pose_file.h"
#include "sim/reference_integrator.h"
#include "sim/renderer.h"
#include "sim/sensor_model.h"
#include "station/commands.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

// The image and what is to be said about how it was made.
struct Outcome {
    Radiance radiance;
    std::string method;                // for people: the plan, or the reference's samples
    int pixels_without_ray = -1;       // -1: not told by this method
    double standard_error_gray = 0.0;  // largest, of the reference
};

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

void check_noise(const RenderArguments& arguments, const CameraModel& camera) {
    if (!arguments.noise_seed)
        return;
    if (arguments.linear)
        throw ConfigError({"--noise-seed"}, "noise belongs to code values: not with --linear");
    if (!camera.sensor || camera.sensor->gain_e_per_dn == 0.0)
        throw ConfigError({"--noise-seed"},
                          arguments.camera.string() + " states no noise (sensor.gain_e_per_dn)");
}

// A marker that could not be seen at all is a slip in the pose: better said than rendered.
void check_pose(const Scene& scene, const std::string& pose) {
    const auto fail = [&](const std::string& message) {
        throw ConfigError({"--pose"}, fmt::format("{}: {}", pose, message));
    };
    int behind = 0;
    for (const int u : {0, scene.markers.front().grid.columns()}) {
        for (const int v : {0, scene.markers.front().grid.rows()})
            behind += (scene.markers.front().camera_from_marker *
                       scene.markers.front().grid.point_mm(u, v))
                          .z() <= 0.0;
    }
    if (behind == 4)
        fail("the marker is behind the camera (z points forward)");
    if (behind > 0)
        fail("the marker reaches behind the camera");
    // The marker's z points into the marker, away from whoever sees its front.
    const Eigen::Vector3d inward =
        scene.markers.front().camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    if (inward.dot(scene.markers.front().camera_from_marker.translation) <= 0.0)
        fail("the camera sees the marker's back or its edge");
}

Scene read_scene(const RenderArguments& arguments) {
    if (!(arguments.background >= 0.0 && arguments.background <= 1.0))
        throw ConfigError({"--background"},
                          fmt::format("{} is not a radiance from 0 to 1", arguments.background));
    if (!(arguments.tolerance_gray > 0.0 && std::isfinite(arguments.tolerance_gray)))
        throw ConfigError({"--tolerance"},
                          fmt::format("{} is not a tolerance", arguments.tolerance_gray));
    const Scene scene{
        {{parse_marker(arguments.marker, "--marker").grid, parse_pose(arguments.pose, "--pose")}},
        arguments.background};
    check_pose(scene, arguments.pose);
    return scene;
}

RenderMethod method_of(const std::string& word) {
    if (word == "auto")
        return RenderMethod::automatic;
    if (word == "E")
        return RenderMethod::exact_lens;
    if (word == "C")
        return RenderMethod::exact_area;
    if (word == "reference")
        return RenderMethod::reference;
    throw ConfigError({"--method"}, "'" + word + "' is not one of auto, E, C, reference");
}

// Every pixel until its standard error is below the tolerance or its samples (a quarter of a
// million, some 30 ms) are used up; the largest standard error is reported.
Outcome integrate(const CameraModel& camera, const Scene& scene, double tolerance_gray) {
    ReferenceOptions options;
    options.samples_per_scramble = 1 << 14;
    options.stop_at_gray = tolerance_gray;
    const ReferenceImage image =
        integrate_reference(camera, scene, cv::Rect(0, 0, camera.width, camera.height), options);
    double largest = 0.0;
    cv::minMaxLoc(image.standard_error, nullptr, &largest);
    Outcome outcome{image.mean, {}, -1, largest * 255.0};
    outcome.method = fmt::format("reference, standard error of a pixel up to {:.3g} gray",
                                 outcome.standard_error_gray);
    return outcome;
}

Outcome render(const CameraModel& camera, const Scene& scene, const RenderArguments& arguments) {
    const RenderMethod method = method_of(arguments.method);
    if (method == RenderMethod::reference)
        return integrate(camera, scene, arguments.tolerance_gray);
    RenderOptions options;
    options.method = method;
    options.tolerance_gray = arguments.tolerance_gray;
    const RenderedImage image = Renderer(camera).render(scene, options);
    return {image.radiance, image.plan.describe(),
            static_cast<int>(image.valid.total()) - cv::countNonZero(image.valid), 0.0};
}

void write(const RenderArguments& arguments, const CameraModel& camera, const Radiance& radiance) {
    if (arguments.linear)
        return write_radiance(arguments.out, radiance);
    std::optional<NoiseKey> noise;
    if (arguments.noise_seed)
        noise = NoiseKey{*arguments.noise_seed, 0};
    write_image(arguments.out, SensorModel(camera).expose(radiance, noise));
}

void print_json(const RenderArguments& arguments, const CameraModel& camera, const Scene& scene,
                const Outcome& outcome) {
    const Vector6d pose = vector_from_rigid(scene.markers.front().camera_from_marker);
    ordered_json json = {
        {"etalon", "render/1"},
        {"file", arguments.out.string()},
        {"camera", arguments.camera.string()},
        {"marker", arguments.marker},
        {"camera_from_marker", std::vector<double>(pose.data(), pose.data() + 6)},
        {"background", scene.background},
        {"width", camera.width},
        {"height", camera.height},
        {"linear", arguments.linear},
        {"plan", outcome.method},
    };
    if (!arguments.linear)
        json["bits"] = camera.sensor ? camera.sensor->bits : 8;
    if (arguments.noise_seed)
        json["noise_seed"] = *arguments.noise_seed;
    if (outcome.pixels_without_ray >= 0)
        json["pixels_without_ray"] = outcome.pixels_without_ray;
    else
        json["largest_standard_error_gray"] = outcome.standard_error_gray;
    fmt::print("{}\n", json.dump(2, ' ', false, ordered_json::error_handler_t::replace));
}

}  // namespace

int run_render(const RenderArguments& arguments) {
    check_output(arguments);
    method_of(arguments.method);  // before anything that takes time
    const CameraModel camera = read_camera(arguments.camera);
    check_noise(arguments, camera);
    const Scene scene = read_scene(arguments);
    const auto began = std::chrono::steady_clock::now();
    const Outcome outcome = render(camera, scene, arguments);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - began;
    write(arguments, camera, outcome.radiance);
    fmt::print(stderr, "{}: {} ({:.2f} s)\n", arguments.out.string(), outcome.method,
               seconds.count());
    if (outcome.pixels_without_ray > 0)
        fmt::print(stderr,
                   "{} pixels have no ray (the distortion model ends before them): they "
                   "show the background\n",
                   outcome.pixels_without_ray);
    if (arguments.json)
        print_json(arguments, camera, scene, outcome);
    return 0;
}

}  // namespace etalon
