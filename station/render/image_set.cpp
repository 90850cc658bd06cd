#include "station/render/image_set.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>

#include <array>
#include <limits>

#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/program/ordered_pipeline.h"
#include "core/program/version.h"
#include "report/json_text.h"
#include "report/number_text.h"
#include "report/result_rows.h"
#include "sim/scene/pose_file.h"
#include "station/render/render_view.h"

namespace etalon {
namespace {

constexpr const char* settings_file = "set.json";
constexpr const char* manifest_file = "images.jsonl";
constexpr const char* poses_file = "poses.csv";
constexpr const char* kind = "image-set/1";
constexpr ShardedWork image_set_work{"image set", "pose", "render merge", settings_file};

std::string image_file(std::size_t index, const std::string& extension) {
    return fmt::format("pose-{:06}{}", index, extension);
}

[[noreturn]] void refuse(const std::filesystem::path& folder, const std::string& why) {
    throw ConfigError({"--out"}, fmt::format("'{}' {}", folder.string(), why));
}

bool is_set(const Json& json) {
    return json.is_object() && json.value("etalon", Json()) == kind && json.contains("settings") &&
           json["settings"].is_object();
}

// Whether a set is there, which must have these settings; otherwise the folder must be empty.
bool holds_set(const std::filesystem::path& folder, const Json& settings) {
    std::error_code error;
    if (!std::filesystem::exists(folder / settings_file, error)) {
        if (!std::filesystem::is_empty(folder, error))
            refuse(folder, "is not empty and holds no image set");
        return false;
    }
    const Json there = read_json(folder / settings_file);
    if (!is_set(there))
        refuse(folder, fmt::format("holds a {} that is not of {}", settings_file, kind));
    const std::string key = first_difference(there["settings"], settings);
    if (!key.empty())
        refuse(folder, fmt::format("belongs to another image set: its '{}' differs (see {})", key,
                                   settings_file));
    return true;
}

Json read_set(const std::filesystem::path& folder) {
    const std::filesystem::path path = folder / settings_file;
    Json set = read_json(path);
    if (!is_set(set))
        throw ConfigError({path.string()}, std::string("is not of ") + kind);
    return set;
}

// A shard's lines by pose. Where it was interrupted they are not in order.
class ShardManifest {
public:
    ShardManifest(const std::filesystem::path& folder, std::size_t poses, const Shard& shard)
        : path_(folder / manifest_file), file_(path_, std::ios::binary), count_(shard.count) {
        starts_.assign(shard.units(poses), missing);
        std::string line;
        for (std::int64_t at = 0; std::getline(file_, line) && !file_.eof();
             at += static_cast<std::int64_t>(line.size()) + 1)
            if (const auto pose = pose_of(line); pose && *pose < poses && shard.holds(*pose))
                starts_[*pose / count_] = at;
        file_.clear();
    }

    std::string line(std::size_t pose) {
        const std::int64_t start = starts_[pose / count_];
        std::string text;
        if (start == missing || !file_.seekg(start) || !std::getline(file_, text))
            throw ConfigError({path_.string()},
                              fmt::format("pose {} is missing: the shard is not finished", pose));
        return text;
    }

private:
    static constexpr std::int64_t missing = -1;

    static std::optional<std::size_t> pose_of(std::string_view line) {
        constexpr std::string_view before = "{\"image\":";
        if (!line.starts_with(before))
            return std::nullopt;
        line.remove_prefix(before.size());
        const auto pose = parse_integer(line.substr(0, line.find_first_of(",}")));
        return pose && *pose >= 0 ? std::optional(static_cast<std::size_t>(*pose)) : std::nullopt;
    }

    std::filesystem::path path_;
    std::ifstream file_;
    std::size_t count_;
    std::vector<std::int64_t> starts_;  // by the poses of the shard
};

void link_or_copy(const std::filesystem::path& from, const std::filesystem::path& to) {
    std::error_code error;
    std::filesystem::remove(to, error);
    std::filesystem::create_hard_link(from, to, error);
    if (error)
        std::filesystem::copy_file(from, to, std::filesystem::copy_options::overwrite_existing,
                                   error);
    if (error)
        fail_writing(to, error);
}

// Puts the image of a pose's line into its place in `out`, if it has one.
void take(const std::string& line, std::size_t pose, const std::filesystem::path& from,
          const std::string& extension, const std::filesystem::path& out, MergedImages& merged) {
    const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
    const std::string file = image_file(pose, extension);
    if (json.is_object() && json.contains("refused")) {
        ++merged.refused;
        return;
    }
    if (!json.is_object() || json.value("file", Json()) != file)
        throw ConfigError({(from / manifest_file).string()},
                          fmt::format("the line of pose {} is not as it was written", pose));
    if (json.value("sha256", Json()) != sha256_of_file(from / file))
        throw ConfigError({(from / file).string()}, "is not the image that was rendered");
    link_or_copy(from / file, out / file);
    ++merged.images;
}

std::size_t count_poses(const std::filesystem::path& path) {
    PoseReader reader(path);
    std::size_t count = 0;
    while (reader.next())
        ++count;
    return count;
}

}  // namespace

ImageSet::ImageSet(const std::filesystem::path& folder, const std::string& settings,
                   const std::string& made_from, const std::string& extension, std::size_t poses)
    : lock_(claim_folder(folder)), folder_(folder), extension_(extension), had_(poses) {
    const Json set{{"etalon", kind},
                   {"settings", Json::parse(settings)},
                   {"made_from", Json::parse(made_from)}};
    if (!holds_set(folder, set["settings"]))
        write_text(folder / settings_file, text_of(set) + "\n");
    // Without lines of missing images, of refused poses (which cost nothing), and broken ones.
    const std::filesystem::path path = folder / manifest_file;
    {
        std::ifstream old(path, std::ios::binary);
        AtomicFile kept(path);
        for (std::string line; std::getline(old, line);)
            if (keeps(line))
                kept.write(line + "\n");
        kept.commit();
    }
    manifest_.emplace(path);
}

std::string ImageSet::file_name(std::size_t index) const {
    return image_file(index, extension_);
}

bool ImageSet::keeps(const std::string& line) {
    const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
    if (!json.is_object() || !json.contains("file") || !json.contains("image") ||
        !json["image"].is_number_unsigned())
        return false;
    const auto index = json["image"].get<std::size_t>();
    std::error_code ignored;
    if (index >= had_.size() || had_[index] || json["file"] != file_name(index) ||
        !std::filesystem::is_regular_file(folder_ / file_name(index), ignored))
        return false;
    ++had_images_;
    had_[index] = true;
    return true;
}

void ImageSet::add(const std::string& line) {
    manifest_->write(line + "\n");
}

MergedImages merge_image_sets(const std::vector<std::filesystem::path>& shards,
                              const std::filesystem::path& out) {
    std::vector<std::string> descriptions;
    for (const std::filesystem::path& folder : shards)
        descriptions.push_back(read_set(folder)["settings"].dump());
    const auto in_order = shards_in_order(image_set_work, shards, descriptions);
    Json set = read_set(in_order[0]);
    set["settings"].erase("shard");
    const std::filesystem::path poses_path = in_order[0] / poses_file;
    const Json hash = set["settings"].value("poses", Json::object());
    if (hash != Json{{"sha256", sha256_of_file(poses_path)}})
        throw ConfigError({poses_path.string()}, "is not the poses that the set was made from");
    const std::size_t poses = count_poses(poses_path);
    const std::string extension = set["settings"].value("linear", false) ? ".tiff" : ".png";
    std::vector<ShardManifest> manifests;
    for (std::size_t i = 0; i < in_order.size(); ++i)
        manifests.emplace_back(in_order[i], poses, Shard{i + 1, in_order.size()});
    const FolderLock lock = claim_folder(out);
    if (!holds_set(out, set["settings"]))
        write_text(out / settings_file, text_of(set) + "\n");

    MergedImages merged;
    AtomicFile manifest(out / manifest_file);
    for (std::size_t pose = 0; pose < poses; ++pose) {
        const std::size_t from = pose % in_order.size();
        const std::string line = manifests[from].line(pose);
        take(line, pose, in_order[from], extension, out, merged);
        manifest.write(line + "\n");
    }
    link_or_copy(poses_path, out / poses_file);
    manifest.commit();
    return merged;
}

namespace {

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
Json marker_settings(const Marker& marker, const Rigid& scene_from_marker) {
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
        std::error_code ignored;
        if (std::filesystem::equivalent(path_, to, ignored))  // a set continued from its own poses
            return;
        std::ifstream from = open_text(path_, std::numeric_limits<std::uintmax_t>::max());
        AtomicFile copy(to);
        std::array<char, 1 << 16> bytes{};
        while (from.read(bytes.data(), bytes.size()) || from.gcount() > 0)
            copy.write({bytes.data(), static_cast<std::size_t>(from.gcount())});
        if (!from.eof())
            throw ConfigError({path_.string()}, "cannot be read");
        copy.commit();
    }

private:
    std::filesystem::path path_;
    std::string text_;  // of JSON
};

std::string settings_of(const RenderArguments& arguments, const ViewRenderer& renderer,
                        const std::vector<Rigid>& placed, const PosesCopy& poses,
                        const Shard& shard) {
    Json markers = Json::array();
    for (std::size_t i = 0; i < placed.size(); ++i)
        markers.push_back(marker_settings(renderer.markers()[i], placed[i]));
    Json background;
    if (const auto radiance = parse_number(arguments.background))
        background = *radiance;
    else
        background = {{"sha256", sha256_of_file(arguments.background)}};
    Json settings{{"version", version},
                  {"camera", {{"sha256", camera_sha256(arguments.camera, renderer.camera())}}},
                  {"markers", markers},
                  {"background", background},
                  {"poses", {{"sha256", poses.hash()}}},
                  {"method", arguments.method},
                  {"tolerance_gray", arguments.tolerance_gray},
                  {"exposure", arguments.exposure},
                  {"velocity", arguments.velocity},
                  {"shutter_ms", arguments.shutter_ms},
                  {"linear", arguments.linear},
                  {"noise_seed", or_null(arguments.noise_seed)}};
    if (!shard.is_all())
        settings["shard"] = {shard.index, shard.count};
    return settings.dump();
}

// Writes the image. Its line of images.jsonl, and why it cannot be rendered, or empty.
using MadeImage = std::pair<std::string, std::string>;

MadeImage make_image(std::size_t i, const Rigid& camera_from_scene,
                     const std::vector<Rigid>& scene_from_markers, const ViewRenderer& renderer,
                     const ImageSet& set) {
    Json line{{"image", i}, {"camera_from_scene", pose_numbers(camera_from_scene)}};
    std::vector<Rigid> camera_from_markers;
    for (const Rigid& scene_from_marker : scene_from_markers)
        camera_from_markers.push_back(camera_from_scene * scene_from_marker);
    try {
        const View view = renderer.render(renderer.scene(camera_from_markers));
        const std::string file = set.file_name(i);
        renderer.write(set.folder() / file, view, static_cast<std::uint32_t>(i));
        line["file"] = file;
        line["sha256"] = sha256_of_file(set.folder() / file);
        add_method(view, line);
        return {line.dump(), ""};
    } catch (const NumericalError& error) {
        line["refused"] = error.what();
        return {line.dump(), fmt::format("pose {}: {}", i, error.what())};
    }
}

}  // namespace

SetResult render_set(const RenderArguments& arguments, std::stop_token stop, Progress& progress) {
    const std::vector<Rigid> placed = scene_from_markers(arguments);
    const Shard shard = parse_shard(arguments.shard);
    // What is wrong with the file is said before anything is rendered.
    const std::size_t count = count_poses(arguments.pose_file);
    PoseReader poses(arguments.pose_file);
    const PosesCopy copy(arguments.pose_file);
    const ViewRenderer renderer(arguments);
    const Json names{{"camera", arguments.camera.string()},
                     {"markers", arguments.markers},
                     {"background", arguments.background},
                     {"poses", arguments.pose_file.string()}};
    ImageSet set(arguments.out, settings_of(arguments, renderer, placed, copy, shard),
                 text_of(names, -1), arguments.linear ? ".tiff" : ".png", count);
    copy.write(set.folder() / "poses.csv");
    SetResult result{.already_there = set.had_images()};
    const std::size_t missing = shard.units(count) - set.had_images();
    if (missing == 0)
        return result;

    std::size_t index = 0;  // of the pose that `poses` gives next
    using SetPose = std::pair<std::size_t, Rigid>;
    const auto next_missing = [&]() -> std::optional<SetPose> {
        result.complete = false;
        while (!stop.stop_requested()) {
            const auto pose = poses.next();
            result.complete = !pose;
            if (!pose)
                break;
            const std::size_t i = index++;
            if (i < count && shard.holds(i) && !set.had(i))
                return SetPose{i, *pose};
        }
        return std::nullopt;
    };
    // Isolated: while a render waits for its own tasks, its thread must not begin another image.
    const auto make = [&](const SetPose& pose) {
        return tbb::this_task_arena::isolate(
            [&] { return make_image(pose.first, pose.second, placed, renderer, set); });
    };
    const auto record = [&](const MadeImage& made) {
        const auto& [line, refusal] = made;
        set.add(line);
        ++(refusal.empty() ? result.rendered : result.refused);
        if (result.first_refusal.empty())
            result.first_refusal = refusal;
        progress.step();
    };
    progress.begin("render", static_cast<int>(missing));
    process_in_order(next_missing, make, record);
    progress.end();
    return result;
}

}  // namespace etalon
