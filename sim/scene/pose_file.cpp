#include "sim/scene/pose_file.h"

#include <fmt/format.h>

#include <numbers>

#include "core/errors.h"
#include "core/strict_reader.h"
#include "core/text.h"

namespace etalon {
namespace {

constexpr std::string_view csv_header = "rx,ry,rz,tx,ty,tz";
constexpr double max_rotation_rad = 2.0 * std::numbers::pi;
constexpr double max_distance_mm = 1e6;

Rigid pose_from_numbers(const std::vector<double>& numbers, const SourcePlace& place) {
    const Vector6d pose = Eigen::Map<const Vector6d>(numbers.data());
    // stableNorm: hostile numbers must not overflow on their way to being refused.
    if (pose.head<3>().stableNorm() > max_rotation_rad * (1.0 + 1e-12))
        throw ConfigError(place,
                          fmt::format("the rotation vector ({}, {}, {}) is longer than 2 pi: "
                                      "it is meant in radians",
                                      pose[0], pose[1], pose[2]));
    if (pose.tail<3>().stableNorm() > max_distance_mm)
        throw ConfigError(place, fmt::format("the translation ({}, {}, {}) mm is longer than a "
                                             "kilometre",
                                             pose[3], pose[4], pose[5]));
    return rigid_from_vector(pose);
}

std::vector<double> numbers_of_line(const std::string& line, const SourcePlace& place) {
    try {
        return parse_numbers(line, 6, place.file);
    } catch (const ConfigError& error) {
        // The same words with the line's number before them.
        const std::string words = error.what();
        throw ConfigError(place, words.substr(place.file.size() + 2));
    }
}

std::vector<Rigid> read_csv(const std::filesystem::path& path) {
    const std::string name = path.string();
    std::vector<std::string> lines = split(read_text(path), '\n');
    while (!lines.empty() && trimmed(lines.back()).empty())
        lines.pop_back();
    if (lines.empty() || trimmed(lines[0]) != csv_header)
        throw ConfigError({name, 1}, fmt::format("the first line must be '{}'", csv_header));
    std::vector<Rigid> poses;
    for (std::size_t i = 1; i < lines.size(); ++i) {
        const SourcePlace place{name, static_cast<int>(i) + 1};
        poses.push_back(pose_from_numbers(numbers_of_line(lines[i], place), place));
    }
    return poses;
}

Rigid pose_from_json(const Value& value) {
    if (value.is_list())
        return pose_from_numbers(value.numbers(6), value.place());
    std::vector<double> numbers;
    for (const std::string& key : split(std::string(csv_header), ','))
        numbers.push_back(value.at(key).number());
    return pose_from_numbers(numbers, value.place());
}

// A bare list has no place for `etalon: KIND`: it is put into one that has, on the same line, so
// that the strict reader's checks and line numbers hold.
std::vector<Rigid> read_json(const std::filesystem::path& path) {
    const std::string wrapped = "{\"etalon\": \"poses/1\", \"poses\": " + read_text(path) + "\n}";
    const StrictFile file = StrictFile::from_text(wrapped, path.string(), "poses/1");
    std::vector<Rigid> poses;
    for (const Value& value : file.root().at("poses").items())
        poses.push_back(pose_from_json(value));
    file.finish();
    return poses;
}

bool is_json(const std::filesystem::path& path) {
    if (path.extension() == ".json")
        return true;
    if (path.extension() == ".csv")
        return false;
    throw ConfigError({path.string()}, "a pose file ends in .csv or .json");
}

}  // namespace

Rigid parse_pose(const std::string& text, const std::string& place) {
    return pose_from_numbers(parse_numbers(text, 6, place), {place});
}

std::vector<Rigid> read_poses(const std::filesystem::path& path) {
    std::vector<Rigid> poses = is_json(path) ? read_json(path) : read_csv(path);
    if (poses.empty())
        throw ConfigError({path.string()}, "holds no pose");
    return poses;
}

}  // namespace etalon
