#include "station/render/image_set.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/file/sha256.h"
#include "core/file/text.h"
#include "core/program/errors.h"
#include "report/json_text.h"
#include "report/result_rows.h"
#include "sim/scene/pose_file.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

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

void make_set_folder(const std::filesystem::path& folder) {
    make_folder(folder);
    std::error_code error;
    if (!std::filesystem::is_empty(folder, error))
        refuse(folder, "is not empty and holds no image set");
}

bool is_set(const ordered_json& json) {
    return json.is_object() && json.value("etalon", ordered_json()) == kind &&
           json.contains("settings") && json["settings"].is_object();
}

void check_same(const std::filesystem::path& folder, const ordered_json& settings) {
    const ordered_json there = read_json(folder / settings_file);
    if (!is_set(there))
        refuse(folder, fmt::format("holds a {} that is not of {}", settings_file, kind));
    const std::string key = first_difference(there["settings"], settings);
    if (!key.empty())
        refuse(folder, fmt::format("belongs to another image set: its '{}' differs (see {})", key,
                                   settings_file));
}

// --------------------------------------------------------------------------------------- merging

ordered_json read_set(const std::filesystem::path& folder) {
    const std::filesystem::path path = folder / settings_file;
    ordered_json set = read_json(path);
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
    const ordered_json json = ordered_json::parse(line, nullptr, /*allow_exceptions=*/false);
    const std::string file = image_file(pose, extension);
    if (json.is_object() && json.contains("refused")) {
        ++merged.refused;
        return;
    }
    if (!json.is_object() || json.value("file", ordered_json()) != file)
        throw ConfigError({(from / manifest_file).string()},
                          fmt::format("the line of pose {} is not as it was written", pose));
    if (json.value("sha256", ordered_json()) != sha256_of_file(from / file))
        throw ConfigError({(from / file).string()}, "is not the image that was rendered");
    link_or_copy(from / file, out / file);
    ++merged.images;
}

// How many there are; they must be those of the set.
std::size_t count_poses_of_set(const std::filesystem::path& poses, const ordered_json& settings) {
    const ordered_json hash = settings.value("poses", ordered_json::object());
    if (hash != ordered_json{{"sha256", sha256_of_file(poses)}})
        throw ConfigError({poses.string()}, "is not the poses that the set was made from");
    PoseReader reader(poses);
    std::size_t count = 0;
    while (reader.next())
        ++count;
    return count;
}

}  // namespace

ImageSet::ImageSet(const std::filesystem::path& folder, const std::string& settings,
                   const std::string& made_from, const std::string& extension, std::size_t poses)
    : folder_(folder), extension_(extension), had_(poses) {
    open_settings(settings, made_from);
    open_manifest();
}

void ImageSet::open_settings(const std::string& settings, const std::string& made_from) {
    std::error_code ignored;
    if (std::filesystem::exists(folder_ / settings_file, ignored))
        return check_same(folder_, ordered_json::parse(settings));
    make_set_folder(folder_);
    const ordered_json set{{"etalon", kind},
                           {"settings", ordered_json::parse(settings)},
                           {"made_from", ordered_json::parse(made_from)}};
    write_text(folder_ / settings_file, text_of(set) + "\n");
}

std::string ImageSet::file_name(std::size_t index) const {
    return image_file(index, extension_);
}

// Without the lines of images that are gone, of refused poses (refusing them again costs nothing),
// and what a broken run left half written.
void ImageSet::open_manifest() {
    const std::filesystem::path path = folder_ / manifest_file;
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

bool ImageSet::keeps(const std::string& line) {
    const ordered_json json = ordered_json::parse(line, nullptr, /*allow_exceptions=*/false);
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
    ordered_json set = read_set(in_order[0]);
    set["settings"].erase("shard");
    const std::filesystem::path poses_path = in_order[0] / poses_file;
    const std::size_t poses = count_poses_of_set(poses_path, set["settings"]);
    const std::string extension = set["settings"].value("linear", false) ? ".tiff" : ".png";
    std::vector<ShardManifest> manifests;
    for (std::size_t i = 0; i < in_order.size(); ++i)
        manifests.emplace_back(in_order[i], poses, Shard{i + 1, in_order.size()});
    std::error_code ignored;
    if (std::filesystem::exists(out / settings_file, ignored))
        check_same(out, set["settings"]);
    else
        make_set_folder(out);
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

}  // namespace etalon
