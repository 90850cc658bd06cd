#include "stage/axes/error_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/config/csv_file.h"
#include "core/geometry/units.h"

namespace etalon {
namespace {

ErrorMapPoint point_of(const std::vector<double>& row, bool rotary, const SourcePlace& place) {
    const Range position = (rotary ? units::deg : units::mm).either_sign();
    const Range error = (rotary ? units::deg : units::um).either_sign();
    for (std::size_t i = 0; i < row.size(); ++i)
        if (const Range& range = i == 0 ? position : error; !range.contains(row[i]))
            throw ConfigError(place, fmt::format("{} must be {}", row[i], range.words()));
    if (row[2] < 0.0)
        throw ConfigError(place, fmt::format("the standard uncertainty {} is negative", row[2]));
    const double error_unit = rotary ? rad_per_deg : 1e-3;
    return {row[0] * (rotary ? rad_per_deg : 1.0), row[1] * error_unit, row[2] * error_unit};
}

ErrorMap read_csv_map(const std::filesystem::path& path, bool rotary) {
    const char* header =
        rotary ? "position_deg,error_deg,uncertainty_deg" : "position_mm,error_um,uncertainty_um";
    std::vector<ErrorMapPoint> points;
    for (const CsvRow& row : read_csv(path, {header}).rows)
        points.push_back(point_of(row.numbers(), rotary, row.place));
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
        return read_csv_map(folder / value.at("file").text(), rotary);
    }
    std::vector<ErrorMapPoint> points;
    for (const Value& row : value.items())
        points.push_back(point_of(row.numbers(3, any_number), rotary, row.place()));
    return {std::move(points), value.place()};
}

}  // namespace etalon
