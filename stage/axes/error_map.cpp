#include "stage/axes/error_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "core/text.h"
#include "core/units.h"

namespace etalon {
namespace {

constexpr double mm_per_um = 1e-3;

ErrorMapPoint point_of(const std::vector<double>& row, bool rotary, const SourcePlace& place) {
    if (row[2] < 0.0)
        throw ConfigError(place, fmt::format("the standard uncertainty {} is negative", row[2]));
    const double error_unit = rotary ? rad_per_deg : mm_per_um;
    return {row[0] * (rotary ? rad_per_deg : 1.0), row[1] * error_unit, row[2] * error_unit};
}

ErrorMap read_csv(const std::filesystem::path& path, bool rotary) {
    const std::string header =
        rotary ? "position_deg,error_deg,uncertainty_deg" : "position_mm,error_um,uncertainty_um";
    const std::vector<std::string> lines = split(read_text(path), '\n');
    if (trimmed(lines.front()) != header)
        throw ConfigError({path.string(), 1}, fmt::format("must be '{}'", header));
    std::vector<ErrorMapPoint> points;
    for (std::size_t i = 1; i < lines.size(); ++i) {
        if (trimmed(lines[i]).empty())
            continue;
        const std::string place = fmt::format("{}:{}", path.string(), i + 1);
        const SourcePlace line{path.string(), static_cast<int>(i) + 1};
        points.push_back(point_of(parse_numbers(trimmed(lines[i]), 3, place), rotary, line));
    }
    return {std::move(points), {path.string()}};
}

}  // namespace

ErrorMap::ErrorMap(std::vector<ErrorMapPoint> points, const SourcePlace& place)
    : points_(std::move(points)) {
    if (points_.size() < 2)
        throw ConfigError(place, "an error map needs at least two points");
    for (std::size_t i = 1; i < points_.size(); ++i)
        if (!(points_[i].position > points_[i - 1].position))
            throw ConfigError(place, fmt::format("the positions of an error map must rise, but "
                                                 "point {} does not",
                                                 i + 1));
}

std::optional<ErrorMapPoint> ErrorMap::at(double position) const {
    const double low = points_.front().position, high = points_.back().position;
    const double reach = 1e-3 * (high - low);
    if (!(position >= low - reach && position <= high + reach))
        return std::nullopt;
    const double inside = std::clamp(position, low, high);
    const auto after = std::find_if(points_.begin() + 1, points_.end() - 1,
                                    [&](const auto& point) { return point.position >= inside; });
    const ErrorMapPoint &a = *(after - 1), &b = *after;
    const double share = (inside - a.position) / (b.position - a.position);
    return ErrorMapPoint{position, std::lerp(a.error, b.error, share),
                         std::lerp(a.uncertainty, b.uncertainty, share)};
}

ErrorMap read_error_map(const Value& value, bool rotary) {
    if (value.is_mapping()) {
        const std::filesystem::path folder =
            std::filesystem::path(value.place().file).parent_path();
        return read_csv(folder / value.at("file").text(), rotary);
    }
    std::vector<ErrorMapPoint> points;
    for (const Value& row : value.items())
        points.push_back(point_of(row.numbers(3), rotary, row.place()));
    return {std::move(points), value.place()};
}

}  // namespace etalon
