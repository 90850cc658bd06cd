#include "station/render/render_set.h"

#include <fmt/format.h>
#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <nlohmann/json.hpp>

#include "calib/camera/camera_model.h"
#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "core/program/version.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "report/result_rows.h"
#include "sim/scene/pose_file.h"
#include "station/render/image_set.h"
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

// The set's own copy of the poses stands for the file: a CSV as it is, JSON in the same form.
class PosesCopy {
public:
    explicit PosesCopy(const std::filesystem::path& path) : path_(path) {
        if (path.extension() == ".csv")
            return;
        text_ = "rx,ry,rz,tx,ty,tz\n";
        for (const Rigid& pose : read_poses(path))
            text_ += fmt::format("{}\n", fmt::join(pose_numbers(pose), ","));
    }

    std::string hash() const { return text_.empty() ? sha256_of_file(path_) : sha256(text_); }

    void write(const std::filesystem::path& to) const {
        if (!text_.empty())
            return write_text(to, text_);
        const std::string part = to.string() + ".part";
        std::error_code error;
        std::filesystem::copy_file(path_, part, std::filesystem::copy_options::overwrite_existing,
                                   error);
        if (!error)
            std::filesystem::rename(part, to, error);
        if (error)
            fail_writing(to, error);
    }

private:
    std::filesystem::path path_;
    std::string text_;  // of JSON
};

// All of them, read once: what is wrong with the file is said before anything is rendered.
std::size_t count_poses(const std::filesystem::path& path) {
    PoseReader reader(path);
    std::size_t count = 0;
    while (reader.next())
        ++count;
    return count;
}

std::string settings_of(const RenderArguments& arguments, const ViewRenderer& renderer,
                        const std::vector<Rigid>& placed, const PosesCopy& poses,
                        const Shard& shard) {
    ordered_json markers = ordered_json::array();
    for (std::size_t i = 0; i < placed.size(); ++i)
        markers.push_back(marker_settings(renderer.markers()[i], placed[i]));
    ordered_json settings{
        {"version", version},
        {"camera", {{"sha256", camera_sha256(arguments.camera, renderer.camera())}}},
        {"markers", markers},
        {"background", background_settings(arguments.background)},
        {"poses", {{"sha256", poses.hash()}}},
        {"method", arguments.method},
        {"tolerance_gray", arguments.tolerance_gray},
        {"exposure", arguments.exposure},
        {"velocity", arguments.velocity},
        {"shutter_ms", arguments.shutter_ms},
        {"linear", arguments.linear},
        {"noise_seed", nullptr}};
    if (arguments.noise_seed)
        settings["noise_seed"] = *arguments.noise_seed;
    if (!shard.is_all())
        settings["shard"] = {shard.index, shard.count};
    return settings.dump();
}

std::string names_of(const RenderArguments& arguments) {
    const ordered_json names{{"camera", arguments.camera.string()},
                             {"markers", arguments.markers},
                             {"background", arguments.background},
                             {"poses", arguments.pose_file.string()}};
    return text_of(names, -1);
}

struct SetPose {
    std::size_t index = 0;
    Rigid camera_from_scene;
};

// What became of one pose: its line of images.jsonl.
struct MadeImage {
    std::size_t index = 0;
    std::string line;
    std::string refusal;  // why; empty if it was rendered
};

// The image of a pose, in its place; or why it cannot be rendered.
MadeImage make_image(const SetPose& pose, const std::vector<Rigid>& scene_from_markers,
                     const ViewRenderer& renderer, const ImageSet& set) {
    const std::size_t i = pose.index;
    ordered_json line{{"image", i}, {"camera_from_scene", pose_numbers(pose.camera_from_scene)}};
    std::vector<Rigid> camera_from_markers;
    for (const Rigid& scene_from_marker : scene_from_markers)
        camera_from_markers.push_back(pose.camera_from_scene * scene_from_marker);
    try {
        const View view = renderer.render(renderer.scene(camera_from_markers));
        const std::string file = set.file_name(i);
        renderer.write(set.folder() / file, view, static_cast<std::uint32_t>(i));
        line["file"] = file;
        line["sha256"] = sha256_of_file(set.folder() / file);
        add_method(view, line);
        return {i, line.dump(), ""};
    } catch (const NumericalError& error) {
        line["refused"] = error.what();
        return {i, line.dump(), error.what()};
    }
}

}  // namespace

SetResult render_set(const RenderArguments& arguments, std::stop_token stop, Progress& progress) {
    const std::vector<Rigid> placed = scene_from_markers(arguments);
    const Shard shard = parse_shard(arguments.shard);
    const std::size_t count = count_poses(arguments.pose_file);
    PoseReader poses(arguments.pose_file);
    const PosesCopy copy(arguments.pose_file);
    const ViewRenderer renderer(arguments);
    ImageSet set(arguments.out, settings_of(arguments, renderer, placed, copy, shard),
                 names_of(arguments), arguments.linear ? ".tiff" : ".png", count);
    copy.write(set.folder() / "poses.csv");
    SetResult result{.already_there = set.had_images()};
    const std::size_t missing = shard.units(count) - set.had_images();
    if (missing == 0)
        return result;

    std::size_t index = 0;  // of the pose that `poses` gives next
    const auto next_missing = [&](tbb::flow_control& control) -> SetPose {
        result.complete = false;
        while (!stop.stop_requested()) {
            const auto pose = poses.next();
            result.complete = !pose;
            if (!pose)
                break;
            const std::size_t i = index++;
            if (i < count && shard.holds(i) && !set.had(i))
                return {i, *pose};
        }
        control.stop();
        return {};
    };
    // Isolated: while a render waits for its own tasks, its thread must not begin another image.
    const auto make = [&](const SetPose& pose) {
        return tbb::this_task_arena::isolate(
            [&] { return make_image(pose, placed, renderer, set); });
    };
    const auto record = [&](const MadeImage& made) {
        set.add(made.line);
        const bool refused = !made.refusal.empty();
        ++(refused ? result.refused : result.rendered);
        if (refused && result.first_refusal.empty())
            result.first_refusal = fmt::format("pose {}: {}", made.index, made.refusal);
        progress.step();
    };
    // A tenth of a second an image, until the first ones have shown it.
    progress.begin("render", static_cast<int>(missing), std::chrono::milliseconds(100) * missing);
    // Poses go in and lines come out in their order, so that an interrupted set is a whole
    // beginning of the full one.
    const auto in_order = tbb::filter_mode::serial_in_order;
    tbb::parallel_pipeline(
        2 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()),
        tbb::make_filter<void, SetPose>(in_order, next_missing) &
            tbb::make_filter<SetPose, MadeImage>(tbb::filter_mode::parallel, make) &
            tbb::make_filter<MadeImage, void>(in_order, record));
    progress.end();
    return result;
}

}  // namespace etalon
