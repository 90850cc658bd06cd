#include "report/number_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace etalon {

std::string fixed(double value, int decimals) {
    return fmt::format("{:.{}f}", value, decimals);
}

std::string fixed(const std::optional<double>& value, int decimals, const char* missing) {
    return value ? fixed(*value, decimals) : missing;
}

std::string significant(double value, int digits, const char* missing) {
    return std::isfinite(value) ? fmt::format("{:.{}g}", value, digits) : missing;
}

std::string significant(const std::optional<double>& value, int digits, const char* missing) {
    return value ? significant(*value, digits, missing) : missing;
}

std::string value_or_below(double value, double expanded_uncertainty, int digits) {
    return value == 0.0 && expanded_uncertainty > 0.0 ? below + significant(expanded_uncertainty, 2)
                                                      : significant(value, digits);
}

std::string probability_text(double probability) {
    constexpr double least = 1e-4;
    if (probability < least)
        return "< 0.01 %";
    if (probability > 1.0 - least)
        return "> 99.99 %";
    const double percent = 100.0 * probability;
    return percent > 90.0 ? fmt::format("{:.2f} %", percent) : fmt::format("{:.2g} %", percent);
}

int decimals_of(double uncertainty) {
    if (!(uncertainty > 0.0))
        return 6;
    return std::clamp(1 - static_cast<int>(std::floor(std::log10(uncertainty))), 0, 12);
}

std::string counted(std::size_t count, const std::string& noun, const std::string& plural) {
    return fmt::format("{} {}", count, count == 1 ? noun : plural.empty() ? noun + "s" : plural);
}

std::vector<double> pose_numbers(const Rigid& transform) {
    const Vector6d v = vector_from_rigid(transform);
    return {v.data(), v.data() + v.size()};
}

std::vector<std::vector<double>> row_numbers(const Matrix6d& matrix) {
    std::vector<std::vector<double>> rows;
    for (int i = 0; i < 6; ++i) {
        const Vector6d row = matrix.row(i);
        rows.emplace_back(row.data(), row.data() + row.size());
    }
    return rows;
}

std::string pose_columns(const Rigid& transform) {
    const Vector6d v = vector_from_rigid(transform);
    return fmt::format("{:9.5f} {:9.5f} {:9.5f} {:9.3f} {:9.3f} {:9.3f}", v[0], v[1], v[2], v[3],
                       v[4], v[5]);
}

std::string deviation_columns(const Vector6d& deviations) {
    const Vector6d& v = deviations;
    return fmt::format("{:9.1e} {:9.1e} {:9.1e} {:9.4f} {:9.4f} {:9.4f}", v[0], v[1], v[2], v[3],
                       v[4], v[5]);
}

std::string pose_heading() {
    return fmt::format("{:>9} {:>9} {:>9} {:>9} {:>9} {:>9}", "rx rad", "ry", "rz", "tx mm", "ty",
                       "tz");
}

}  // namespace etalon
