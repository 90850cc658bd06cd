// Poses camera_from_marker as people type them and as files hold them: rotation vector (rad), then
// translation (mm), in the order rx, ry, rz, tx, ty, tz.
//
//   CSV    first line `rx,ry,rz,tx,ty,tz`, then a pose a line
//   JSON   [[0, 0, 0.5, 10, -7, 500], ...] or [{"rx": 0, "ry": 0, ... "tz": 500}, ...]
#pragma once

#include "core/config/csv_file.h"
#include "core/geometry/rigid.h"

namespace etalon {

// "rx,ry,rz,tx,ty,tz"; `place` is the option's name. Throws ConfigError unless six finite numbers,
// the rotation within 2 pi (longer: degrees by mistake) and the translation within a kilometre.
Rigid parse_pose(const std::string& text, const std::string& place);

// The format follows from the extension, .csv or .json. Throws ConfigError with file and line for
// whatever is not exactly as above: unknown, doubled and missing keys, an empty list, a blank line
// between poses, poses that parse_pose() would refuse.
std::vector<Rigid> read_poses(const std::filesystem::path& path);

// The same, pose by pose: of a CSV, however long, one is in memory.
class PoseReader {
public:
    explicit PoseReader(const std::filesystem::path& path);

    // Nothing behind the last pose; throws as read_poses().
    std::optional<Rigid> next();

private:
    std::filesystem::path path_;
    std::optional<CsvReader> csv_;  // not of JSON
    std::vector<Rigid> json_;
    std::size_t index_ = 0;
};

}  // namespace etalon
