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

int decimals_of(double uncertainty) {
    if (!(uncertainty > 0.0))
        return 6;
    return std::clamp(1 - static_cast<int>(std::floor(std::log10(uncertainty))), 0, 12);
}

std::string counted(std::size_t count, const std::string& noun) {
    return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

}  // namespace etalon
