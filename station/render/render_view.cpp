#include "station/render/render_view.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "calib/files/camera_file.h"
#include "core/file/text.h"
#include "report/json_text.h"
#include "sim/render/reference_integrator.h"
#include "sim/scene/pose_file.h"

namespace etalon {

namespace {

// What --method may name, and behind these four what only a plan tells.
constexpr std::pair<const char*, RenderMethod> method_words[] = {
    {"auto", RenderMethod::automatic},
    {"E", RenderMethod::exact_lens},
    {"C", RenderMethod::exact_area},
    {"reference", RenderMethod::reference},
    {"wedge table", RenderMethod::wedge_table},
    {"edge table", RenderMethod::edge_table},
    {"wave", RenderMethod::wave}};

RenderMethod method_of(const std::string& word) {
    for (const auto& [name, method] : std::span(method_words).first<4>())
        if (word == name)
            return method;
    throw ConfigError({"--method"}, "'" + word + "' is not one of auto, E, C, reference");
}

double positive_number(double value, const char* option, const char* what) {
    if (!(value > 0.0 && std::isfinite(value)))
        throw ConfigError({option}, fmt::format("{} is not {}", value, what));
    return value;
}

std::optional<MotionDuringExposure> motion_of(const RenderArguments& arguments) {
    if (arguments.velocity.empty() != (arguments.shutter_ms == 0.0))
        throw ConfigError({"--velocity"}, "motion blur needs both --velocity and --shutter");
    if (arguments.velocity.empty())
        return std::nullopt;
    const std::vector<double> numbers = parse_numbers(arguments.velocity, 6, "--velocity");
    return MotionDuringExposure{Vector6d(numbers.data()), arguments.shutter_ms / 1000.0};
}

// What makes a marker one that could not be seen at all; empty if nothing does.
std::string why_unseen(const PlacedMarker& marker, const LensProjection& projection) {
    const CellGrid& grid = marker.grid;
    int behind = 0;  // a wide lens may see behind itself
    for (const int u : {0, grid.columns()}) {
        for (const int v : {0, grid.rows()})
            behind += projection.is_flat() &&
                      (marker.camera_from_marker * grid.point_mm(u, v)).z() <= 0.0;
    }
    if (behind == 4)
        return "is behind the camera (z points forward)";
    if (behind > 0)
        return "reaches behind the camera";
    // The marker's z points into the marker, away from whoever sees its front.
    const Eigen::Vector3d inward = marker.camera_from_marker.rotation * Eigen::Vector3d::UnitZ();
    const bool front = projection.kind == Projection::telecentric
                           ? inward.z() > 0.0
                           : inward.dot(marker.camera_from_marker.translation) > 0.0;
    return front ? "" : "is seen from its back or its edge";
}

// Such a marker is a slip in the pose: better said than rendered.
void check_seen(const Scene& scene, const LensProjection& projection) {
    for (std::size_t i = 0; i < scene.markers.size(); ++i) {
        const std::string why = why_unseen(scene.markers[i], projection);
        if (!why.empty())
            throw NumericalError(scene.markers.size() == 1
                                     ? "the marker " + why
                                     : fmt::format("marker {} {}", i + 1, why));
    }
}

// 8-bit files hold codes of sensors of up to 8 bits, 16-bit files those of the others.
CodeImage with_bits_of(const CodeImage& file, const SensorModel& sensor) {
    const CodeImage image{file.pixels, sensor.bits()};
    if ((file.bits == 8) != (sensor.bits() <= 8))
        throw ConfigError({"--background"},
                          fmt::format("a {}-bit file does not hold codes of a sensor of {} bits",
                                      file.bits, sensor.bits()));
    double largest = 0.0;
    cv::minMaxLoc(image.pixels, nullptr, &largest);
    if (largest > image.full_scale())
        throw ConfigError({"--background"}, fmt::format("code {} is above the sensor's full scale "
                                                        "{}",
                                                        largest, image.full_scale()));
    return image;
}

const char* short_name(RenderMethod method) {
    using Word = std::pair<const char*, RenderMethod>;
    return std::ranges::find(method_words, method, &Word::second)->first;
}

// A row of the table: its name, and text broken into as many lines as it needs.
std::string row(const std::string& name, const std::string& text) {
    return wrapped_text(fmt::format("  {:<14}", name), text, 80);
}

// Of several markers: tiles sampled alike together, of each omission the largest.
std::vector<TileUse> added_up(const std::vector<TileUse>& used) {
    std::vector<TileUse> sums;
    for (const TileUse& use : used) {
        const auto alike = std::ranges::find_if(sums, [&](const TileUse& sum) {
            return sum.method == use.method && sum.lens_points == use.lens_points &&
                   sum.points_per_pixel_side == use.points_per_pixel_side;
        });
        if (alike == sums.end())
            sums.push_back(use);
        else
            alike->tiles += use.tiles;
    }
    return sums;
}

std::vector<NeglectedBound> largest_of_each(const std::vector<NeglectedBound>& left_out) {
    std::vector<NeglectedBound> largest;
    for (const NeglectedBound& left : left_out) {
        const auto same = std::ranges::find(largest, left.what, &NeglectedBound::what);
        if (same == largest.end())
            largest.push_back(left);
        else if (same->gray < left.gray)
            *same = left;
    }
    return largest;
}

std::string words(const TileUse& use) {
    if (use.method == RenderMethod::edge_table)
        return "by the table of edges";
    if (use.method == RenderMethod::wedge_table)
        return "by the table of edges and corners";
    std::string text =
        fmt::format("by {}, k = {}", short_name(use.method), use.points_per_pixel_side);
    if (use.method == RenderMethod::exact_area)
        text += fmt::format(", lens points {}", use.lens_points);
    return text;
}

Json plan_json(const RenderPlan& plan) {
    const auto use_json = [](const TileUse& use) -> Json {
        return {{"method", short_name(use.method)},
                {"k", use.points_per_pixel_side},
                {"lens_points", use.lens_points},
                {"tiles", use.tiles}};
    };
    const auto left_json = [](const NeglectedBound& left) -> Json {
        return {{"what", name_of(left.what)}, {"why", left.why}, {"gray", left.gray}};
    };
    return {{"summary", plan.describe()},
            {"tolerance_gray", plan.tolerance_gray},
            {"sampling_gray", plan.sampling_gray},
            {"border_gray", plan.border_gray},
            {"blur_radius_px", {plan.min_blur_radius_px, plan.max_blur_radius_px}},
            {"tail_reach_px", plan.tail_reach_px},
            {"tiles", json_list(added_up(plan.used), use_json)},
            {"uniform_tiles", plan.uniform_tiles},
            {"left_out", json_list(largest_of_each(plan.left_out), left_json)},
            {"instructions", plan.instructions}};
}

}  // namespace

std::vector<Rigid> parse_poses(const std::vector<std::string>& poses) {
    std::vector<Rigid> parsed;
    for (const std::string& pose : poses)
        parsed.push_back(parse_pose(pose, "--pose"));
    return parsed;
}

std::string View::describe() const {
    if (plan)
        return plan->describe();
    return fmt::format("reference, standard error of a pixel up to {:.3g} gray",
                       standard_error_gray);
}

ViewRenderer::ViewRenderer(const RenderArguments& arguments)
    : exposure_(positive_number(arguments.exposure, "--exposure", "a factor above 0")),
      motion_(motion_of(arguments)),
      noise_seed_(arguments.noise_seed) {
    options_.method = method_of(arguments.method);
    options_.tolerance_gray =
        positive_number(arguments.tolerance_gray, "--tolerance", "a tolerance");
    camera_ = read_any_camera(arguments.camera);
    check_noise(arguments);
    for (const std::string& marker : arguments.markers)
        markers_.push_back(parse_marker(marker, "--marker"));
    read_background(arguments.background);
    if (motion_ && (!background_image_.empty() || options_.method == RenderMethod::reference))
        throw ConfigError({"--velocity"}, "not with a background image or the reference method");
    if (!arguments.linear)
        sensor_.emplace(camera_);
    if (options_.method != RenderMethod::reference)
        renderer_.emplace(camera_);
}

void ViewRenderer::check_noise(const RenderArguments& arguments) const {
    if (!noise_seed_)
        return;
    if (arguments.linear)
        throw ConfigError({"--noise-seed"}, "noise belongs to code values: not with --linear");
    if (!camera_.sensor || camera_.sensor->gain_e_per_dn == 0.0)
        throw ConfigError({"--noise-seed"},
                          arguments.camera.string() + " states no noise (sensor.gain_e_per_dn)");
}

void ViewRenderer::read_background(const std::string& text) {
    if (const auto number = parse_number(text)) {
        if (!(*number >= 0.0 && *number <= 1.0))
            throw ConfigError({"--background"}, text + " is not a radiance from 0 to 1");
        background_ = *number;
        return;
    }
    CodeImage file;
    try {
        file = read_image(text);
    } catch (const ConfigError& error) {
        throw ConfigError(
            {"--background"},
            fmt::format("'{}' is no radiance from 0 to 1, and as a file: {}", text, error.what()));
    }
    const cv::Size size = file.pixels.size();
    if (size != cv::Size(camera_.width, camera_.height))
        throw ConfigError({"--background"},
                          fmt::format("{} has {} x {} px, the camera {} x {}", text, size.width,
                                      size.height, camera_.width, camera_.height));
    const SensorModel sensor(camera_);
    background_image_ = background_from(with_bits_of(file, sensor), sensor);
}

Scene ViewRenderer::scene(const std::vector<Rigid>& camera_from_marker) const {
    Scene scene{{}, background_};
    for (std::size_t i = 0; i < markers_.size(); ++i)
        scene.markers.push_back({markers_[i].grid, camera_from_marker.at(i)});
    check_seen(scene, camera_.projection);
    if (renderer_)
        check_no_occlusion(scene, camera_);
    return scene;
}

View ViewRenderer::render(const Scene& scene) const {
    View view = renderer_ ? render_closed_form(scene) : integrate(scene);
    if (exposure_ != 1.0)
        view.radiance *= exposure_;
    return view;
}

View ViewRenderer::render_closed_form(const Scene& scene) const {
    const RenderedImage image = motion_ ? render_moving(*renderer_, scene, *motion_, options_).image
                                : background_image_.empty()
                                    ? renderer_->render(scene, options_)
                                    : render_over(*renderer_, scene, background_image_, options_);
    return {image.radiance, image.plan,
            static_cast<int>(image.valid.total()) - cv::countNonZero(image.valid), 0.0};
}

// Every pixel until its standard error is below the tolerance or its samples (a quarter of a
// million, some 30 ms) are used up; the largest standard error is reported.
View ViewRenderer::integrate(const Scene& scene) const {
    ReferenceOptions options;
    options.samples_per_scramble = 1 << 14;
    options.stop_at_gray = options_.tolerance_gray;
    const cv::Rect all(0, 0, camera_.width, camera_.height);
    const auto integral = [&](const Scene& seen, View& view) {
        const ReferenceImage image = integrate_reference(camera_, seen, all, options);
        double largest = 0.0;
        cv::minMaxLoc(image.standard_error, nullptr, &largest);
        view.standard_error_gray = std::hypot(view.standard_error_gray, largest * 255.0);
        return image.mean;
    };
    View view;
    if (background_image_.empty()) {
        view.radiance = integral(scene, view);
    } else {
        const Radiance markers = integral(on_black(scene), view);
        const Radiance coverage = integral(white_on_black(scene), view);
        view.radiance = placed_over(markers, coverage, background_image_);
    }
    return view;
}

void ViewRenderer::write(const std::filesystem::path& path, const View& view,
                         std::uint32_t index) const {
    if (!sensor_)
        return write_radiance(path, view.radiance);
    std::optional<NoiseKey> noise;
    if (noise_seed_)
        noise = NoiseKey{*noise_seed_, index};
    write_image(path, sensor_->expose(view.radiance, noise));
}

std::string plan_table(const RenderPlan& plan) {
    std::string text = fmt::format("plan, for at most {:.3g} gray\n", plan.tolerance_gray);
    text += row("blur radius", fmt::format("{:.3g} to {:.3g} px", plan.min_blur_radius_px,
                                           plan.max_blur_radius_px));
    text += row("samples", plan.method == RenderMethod::wedge_table
                               ? fmt::format("none: a table, {:.2g} gray", plan.sampling_gray)
                               : fmt::format("{0} x {0} a pixel: {1:.2g} gray",
                                             plan.points_per_pixel_side, plan.sampling_gray));
    if (plan.border_gray > 0.0)
        text += row(
            "", fmt::format("{:.2g} gray more at the distortion model's end", plan.border_gray));
    text +=
        row("diffraction",
            plan.tail_reach_px > 0.0 ? fmt::format("to {:.0f} px", plan.tail_reach_px) : "no tail");
    std::string name = "tiles";
    const auto counted = [&](std::size_t count, const std::string& what) {
        return wrapped_text(fmt::format("  {:<14}{:>8} ", std::exchange(name, ""), count), what,
                            80);
    };
    for (const TileUse& use : added_up(plan.used))
        text += counted(use.tiles, words(use));
    text += counted(plan.uniform_tiles, "uniform: one number each");
    name = "left out";
    for (const NeglectedBound& left : largest_of_each(plan.left_out))
        if (left.what != NeglectedEffect::uniform_tiles)  // told above
            text +=
                row(std::exchange(name, ""),
                    fmt::format("{}: {} ({:.2g} gray)", name_of(left.what), left.why, left.gray));
    return text;
}

void add_method(const View& view, Json& json) {
    if (view.plan) {
        json["pixels_without_ray"] = view.pixels_without_ray;
        json["plan"] = plan_json(*view.plan);
    } else {
        json["largest_standard_error_gray"] = view.standard_error_gray;
    }
}

}  // namespace etalon
