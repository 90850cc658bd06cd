#include "sim/scene/pose_file.h"

#include <fmt/format.h>

#include <numbers>

#include "core/file/text.h"

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

Rigid pose_from_json(const Value& value) {
    if (value.is_list())
        return pose_from_numbers(value.numbers(6, any_number), value.place());
    std::vector<double> numbers;
    for (const std::string& key : split(std::string(csv_header), ','))
        numbers.push_back(value.at(key).number(any_number));
    return pose_from_numbers(numbers, value.place());
}

// A bare list has no place for `etalon: KIND`: it is put into one that has, on the same line, so
// that the strict reader's checks and line numbers hold.
std::vector<Rigid> read_json_poses(const std::filesystem::path& path) {
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

PoseReader::PoseReader(const std::filesystem::path& path) : path_(path) {
    if (is_json(path))
        json_ = read_json_poses(path);
    else
        csv_.emplace(path, std::initializer_list<std::string_view>{csv_header});
}

std::optional<Rigid> PoseReader::next() {
    std::optional<Rigid> pose;
    if (csv_) {
        if (const auto row = csv_->next())
            pose = pose_from_numbers(row->numbers(), row->place);
    } else if (index_ < json_.size()) {
        pose = json_[index_];
    }
    if (!pose && index_ == 0)
        throw ConfigError({path_.string()}, "holds no pose");
    ++index_;
    return pose;
}

std::vector<Rigid> read_poses(const std::filesystem::path& path) {
    PoseReader reader(path);
    std::vector<Rigid> poses;
    while (const auto pose = reader.next())
        poses.push_back(*pose);
    return poses;
}

}  // namespace etalon
