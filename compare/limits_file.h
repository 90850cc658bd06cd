// The limits that a camera is judged by: a versioned file with an id.
//
//     etalon: limits/1
//     id: demo-1
//     b3_position_field_rms_mm: {limit: 0.06, unit: mm}
//     b3_position_field_max_mm: {limit: 0.20, unit: mm}
//     b3_rotation_field_rms_mrad: {limit: 1.0, unit: mrad}     # optional
//     b3_rotation_field_max_mrad: {limit: 3.0, unit: mrad}     # optional
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace etalon {

struct Limits {
    std::string id;
    double b3_position_field_rms_mm = 0.0;  // > 0
    double b3_position_field_max_mm = 0.0;  // > 0
    std::optional<double> b3_rotation_field_rms_mrad;
    std::optional<double> b3_rotation_field_max_mrad;
};

// Throws ConfigError with file, line and key: unknown, missing or doubled keys, a limit that is not
// a positive number, a unit other than the one in the quantity's name.
Limits read_limits(const std::filesystem::path& path);

}  // namespace etalon
