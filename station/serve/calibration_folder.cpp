#include "station/serve/calibration_folder.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <vector>

#include "calib/files/camera_file.h"
#include "core/config/strict_reader.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

using Path = std::filesystem::path;

std::vector<Path> camera_files(const Path& folder) {
    std::vector<Path> files;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        const std::string kind = entry.path().extension().string();
        std::error_code ignored;
        if ((kind == ".yml" || kind == ".yaml" || kind == ".json") &&
            entry.is_regular_file(ignored) && is_etalon_file(entry.path()))
            files.push_back(entry.path());
    }
    if (error)
        throw ConfigError({folder.string()}, "cannot be read: " + error.message());
    std::ranges::sort(files);
    return files;
}

// Empty for what is no camera's file: a station's may lie beside it.
std::string serial_in(const Path& file) {
    try {
        return read_any_camera(file).serial;
    } catch (const ConfigError&) {
        return {};
    }
}

std::string listed(std::vector<std::string> serials) {
    constexpr std::size_t most = 8;
    const std::size_t more = serials.size() - std::min(serials.size(), most);
    serials.resize(serials.size() - more);
    return fmt::format("{}{}", fmt::join(serials, ", "),
                       more > 0 ? fmt::format(" and {} more", more) : "");
}

}  // namespace

Path calibration_of(const Path& folder, const std::string& serial) {
    std::vector<Path> found;
    std::vector<std::string> others;
    for (const Path& file : camera_files(folder)) {
        const std::string there = serial_in(file);
        if (!there.empty() && there == serial)
            found.push_back(file);
        else if (!there.empty())
            others.push_back(there);
    }
    if (found.size() > 1)
        throw ConfigError(
            {folder.string()},
            fmt::format("{} and {} are both of camera {}: keep one", found[0].filename().string(),
                        found[1].filename().string(), serial));
    if (found.empty())
        throw ConfigError(
            {folder.string()},
            fmt::format("has no calibration of camera {}{}", serial,
                        others.empty() ? "" : "; there are those of " + listed(others)));
    return found.front();
}

}  // namespace etalon
