#include "station/render/render_set.h"

#include <fmt/format.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <nlohmann/json.hpp>

#include "calib/camera/camera_hash.h"
#include "core/errors.h"
#include "core/pose_numbers.h"
#include "core/sha256.h"
#include "core/text.h"
#include "core/version.h"
#include "report/json_text.h"
#include "sim/scene/pose_file.h"
#include "station/render/image_set.h"
#include "station/render/render_plan_text.h"
#include "station/render/render_view.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

std::vector<Rigid> scene_from_markers(const RenderArguments& arguments) {
    if (arguments.poses.empty() && arguments.markers.size() == 1)
        return {Rigid{}};
    if (arguments.poses.size() != arguments.markers.size())
        throw ConfigError({"--pose"},
                          fmt::format("{} for {} markers: with --poses each of several markers "
                                      "needs one, where it is in the scene",
                                      arguments.poses.size(), arguments.markers.size()));
    return parse_poses(arguments.poses);
}

// Content only: the same picture under another name is the same.
ordered_json marker_settings(const Marker& marker, const Rigid& scene_from_marker) {
    const CellGrid& grid = marker.grid;
    const cv::Mat cells = grid.cells.clone();  // without gaps between rows
    const std::string_view bytes(reinterpret_cast<const char*>(cells.data),
                                 cells.total() * cells.elemSize());
    return {{"cells", {grid.columns(), grid.rows()}},
            {"corner_mm", {grid.corner_mm.x(), grid.corner_mm.y()}},
            {"cell_mm", {grid.cell_mm.x(), grid.cell_mm.y()}},
            {"sha256", sha256(bytes)},
            {"scene_from_marker", pose_numbers(scene_from_marker)}};
}

ordered_json background_settings(const std::string& text) {
    if (const auto number = parse_number(text))
        return *number;
    return {{"sha256", sha256_of_file(text)}};
}

// A CSV as it is, so that the set's own copy stands for it; JSON in the same form.
std::string poses_text(const std::filesystem::path& path, const std::vector<Rigid>& poses) {
    if (path.extension() == ".csv")
        return read_text(path);
    std::string text = "rx,ry,rz,tx,ty,tz\n";
    for (const Rigid& pose : poses)
        text += fmt::format("{}\n", fmt::join(pose_numbers(pose), ","));
    return text;
}

std::string settings_of(const RenderArguments& arguments, const ViewRenderer& renderer,
                        const std::vector<Rigid>& placed, const std::string& poses) {
    ordered_json markers = ordered_json::array();
    for (std::size_t i = 0; i < placed.size(); ++i)
        markers.push_back(marker_settings(renderer.markers()[i], placed[i]));
    ordered_json settings{
        {"version", version},
        {"camera", {{"sha256", camera_sha256(arguments.camera, renderer.camera())}}},
        {"markers", markers},
        {"background", background_settings(arguments.background)},
        {"poses", {{"sha256", sha256(poses)}}},
        {"method", arguments.method},
        {"tolerance_gray", arguments.tolerance_gray},
        {"exposure", arguments.exposure},
        {"velocity", arguments.velocity},
        {"shutter_ms", arguments.shutter_ms},
        {"linear", arguments.linear},
        {"noise_seed", nullptr}};
    if (arguments.noise_seed)
        settings["noise_seed"] = *arguments.noise_seed;
    return settings.dump();
}

std::string names_of(const RenderArguments& arguments) {
    const ordered_json names{{"camera", arguments.camera.string()},
                             {"markers", arguments.markers},
                             {"background", arguments.background},
                             {"poses", arguments.pose_file.string()}};
    return text_of(names, -1);
}

// What became of one pose: its line of images.jsonl.
struct MadeImage {
    std::size_t index = 0;
    std::string line;
    std::string refusal;  // why; empty if it was rendered
};

class SetRenderer {
public:
    SetRenderer(const RenderArguments& arguments, std::stop_token stop, Progress& progress)
        : stop_(std::move(stop)),
          progress_(progress),
          scene_from_markers_(scene_from_markers(arguments)),
          poses_(read_poses(arguments.pose_file)),
          poses_text_(poses_text(arguments.pose_file, poses_)),
          renderer_(arguments),
          set_(arguments.out, settings_of(arguments, renderer_, scene_from_markers_, poses_text_),
               names_of(arguments), arguments.linear ? ".tiff" : ".png") {
        write_text(set_.folder() / "poses.csv", poses_text_);
        for (std::size_t i = 0; i < poses_.size(); ++i)
            if (!set_.had(i))
                missing_.push_back(i);
        result_.already_there = poses_.size() - missing_.size();
    }

    SetResult render_all() {
        if (missing_.empty())
            return result_;
        // A tenth of a second an image, until the first ones have shown it.
        progress_.begin("render", static_cast<int>(missing_.size()),
                        std::chrono::milliseconds(100) * missing_.size());
        run_pipeline();
        progress_.end();
        return result_;
    }

private:
    // Poses go in and lines come out in their order, so that an interrupted set is a whole
    // beginning of the full one.
    void run_pipeline() {
        const auto in_flight =
            2 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
        tbb::parallel_pipeline(
            in_flight, tbb::make_filter<void, std::size_t>(
                           tbb::filter_mode::serial_in_order,
                           [this](tbb::flow_control& control) { return next_missing(control); }) &
                           tbb::make_filter<std::size_t, MadeImage>(
                               tbb::filter_mode::parallel,
                               // Isolated: while a render waits for its own tasks, its thread must
                               // not begin another image.
                               [this](std::size_t i) {
                                   return tbb::this_task_arena::isolate([&] { return make(i); });
                               }) &
                           tbb::make_filter<MadeImage, void>(
                               tbb::filter_mode::serial_in_order,
                               [this](const MadeImage& outcome) { record(outcome); }));
    }

    std::size_t next_missing(tbb::flow_control& control) {
        result_.complete = next_ == missing_.size();
        if (result_.complete || stop_.stop_requested()) {
            control.stop();
            return 0;
        }
        return missing_[next_++];
    }

    MadeImage make(std::size_t i) const {
        ordered_json line{{"image", i}, {"camera_from_scene", pose_numbers(poses_[i])}};
        try {
            const View view = renderer_.render(renderer_.scene(camera_from_markers(i)));
            const std::string file = set_.file_name(i);
            renderer_.write(set_.folder() / file, view, static_cast<std::uint32_t>(i));
            line["file"] = file;
            line["sha256"] = sha256_of_file(set_.folder() / file);
            describe(view, line);
            return {i, line.dump(), ""};
        } catch (const NumericalError& error) {
            line["refused"] = error.what();
            return {i, line.dump(), error.what()};
        }
    }

    static void describe(const View& view, ordered_json& line) {
        if (view.plan) {
            line["pixels_without_ray"] = view.pixels_without_ray;
            line["plan"] = ordered_json::parse(plan_json(*view.plan));
        } else {
            line["largest_standard_error_gray"] = view.standard_error_gray;
        }
    }

    std::vector<Rigid> camera_from_markers(std::size_t i) const {
        std::vector<Rigid> chained;
        for (const Rigid& scene_from_marker : scene_from_markers_)
            chained.push_back(poses_[i] * scene_from_marker);
        return chained;
    }

    void record(const MadeImage& outcome) {
        set_.add(outcome.line);
        const bool refused = !outcome.refusal.empty();
        ++(refused ? result_.refused : result_.rendered);
        if (refused && result_.first_refusal.empty())
            result_.first_refusal = fmt::format("pose {}: {}", outcome.index, outcome.refusal);
        progress_.step();
    }

    std::stop_token stop_;
    Progress& progress_;
    std::vector<Rigid> scene_from_markers_, poses_;  // poses: camera_from_scene
    std::string poses_text_;
    ViewRenderer renderer_;
    ImageSet set_;
    std::vector<std::size_t> missing_;
    std::size_t next_ = 0;  // of missing_
    SetResult result_;
};

}  // namespace

SetResult render_set(const RenderArguments& arguments, std::stop_token stop, Progress& progress) {
    SetRenderer renderer(arguments, std::move(stop), progress);
    return renderer.render_all();
}

}  // namespace etalon
