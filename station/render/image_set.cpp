#include "station/render/image_set.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/errors.h"
#include "core/text.h"
#include "report/json_text.h"

namespace etalon {
namespace {

using nlohmann::ordered_json;

constexpr const char* settings_file = "set.json";
constexpr const char* manifest_file = "images.jsonl";
constexpr const char* kind = "image-set/1";

[[noreturn]] void refuse(const std::filesystem::path& folder, const std::string& why) {
    throw ConfigError({"--out"}, fmt::format("'{}' {}", folder.string(), why));
}

void make_set_folder(const std::filesystem::path& folder) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error)
        refuse(folder, "cannot be made: " + error.message());
    if (!std::filesystem::is_empty(folder, error))
        refuse(folder, "is not empty and holds no image set");
}

void check_same(const std::filesystem::path& folder, const ordered_json& settings) {
    const ordered_json there = read_json(folder / settings_file);
    if (!there.is_object() || there.value("etalon", ordered_json()) != kind ||
        !there.contains("settings"))
        refuse(folder, fmt::format("holds a {} that is not of {}", settings_file, kind));
    const std::string key = first_difference(there["settings"], settings);
    if (!key.empty())
        refuse(folder, fmt::format("belongs to another image set: its '{}' differs (see {})", key,
                                   settings_file));
}

}  // namespace

ImageSet::ImageSet(const std::filesystem::path& folder, const std::string& settings,
                   const std::string& made_from, const std::string& extension)
    : folder_(folder), extension_(extension) {
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
    return fmt::format("pose-{:06}{}", index, extension_);
}

// Without the lines of images that are gone, of refused poses (refusing them again costs nothing),
// and what a broken run left half written.
void ImageSet::open_manifest() {
    const std::filesystem::path path = folder_ / manifest_file, part = path.string() + ".part";
    {
        std::ifstream old(path, std::ios::binary);
        std::ofstream kept(part, std::ios::binary | std::ios::trunc);
        for (std::string line; std::getline(old, line);)
            if (keeps(line))
                kept << line << "\n";
        kept.close();
        std::error_code error;
        if (kept)
            std::filesystem::rename(part, path, error);
        if (!kept || error)
            throw ConfigError({path.string()}, "cannot be written");
    }
    manifest_.open(path, std::ios::binary | std::ios::app);
}

bool ImageSet::keeps(const std::string& line) {
    const ordered_json json = ordered_json::parse(line, nullptr, /*allow_exceptions=*/false);
    if (!json.is_object() || !json.contains("file") || !json.contains("image") ||
        !json["image"].is_number_unsigned())
        return false;
    const auto index = json["image"].get<std::size_t>();
    std::error_code ignored;
    return json["file"] == file_name(index) &&
           std::filesystem::is_regular_file(folder_ / file_name(index), ignored) &&
           had_.insert(index).second;
}

void ImageSet::add(const std::string& line) {
    manifest_ << line << "\n" << std::flush;
    if (!manifest_)
        throw ConfigError({(folder_ / manifest_file).string()}, "cannot be written");
}

}  // namespace etalon
