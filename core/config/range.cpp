#include "core/config/range.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace etalon {

bool Range::contains(double value) const {
    const bool above = open_low ? value > low : value >= low;
    return above && value <= high;
}

std::string Range::words() const {
    const bool is_named = *unit && std::string_view(unit) != units::one.name;
    const std::string of_unit = is_named ? std::string(" ") + unit : "";
    if (open_low && std::isinf(high))
        return fmt::format("greater than {}{}", low, of_unit);
    if (std::isinf(high))
        return fmt::format("at least {}{}", low, of_unit);
    if (std::isinf(low))
        return fmt::format("at most {}{}", high, of_unit);
    if (open_low)
        return fmt::format("greater than {} and at most {}{}", low, high, of_unit);
    return fmt::format("between {} and {}{}", low, high, of_unit);
}

const Unit& unit_named(std::string_view name) {
    return *std::ranges::find(units::all, name,
                              [](const Unit& u) { return std::string_view(u.name); });
}

}  // namespace etalon
