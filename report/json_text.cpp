#include "report/json_text.h"

#include <nlohmann/json.hpp>

namespace etalon {

using nlohmann::ordered_json;

std::string text_of(const ordered_json& json, int indent) {
    return json.dump(indent, ' ', false, ordered_json::error_handler_t::replace);
}

ordered_json optional_number(const std::optional<double>& value) {
    return value ? ordered_json(*value) : ordered_json();
}

ordered_json software_json(std::span<const SoftwareVersion> software) {
    ordered_json json;
    for (const SoftwareVersion& each : software)
        json[each.name] = each.version;
    return json;
}

std::string first_difference(const ordered_json& there, const ordered_json& asked) {
    for (const auto& [key, value] : asked.items())
        if (!there.contains(key))
            return key;
        else if (there[key] != value && value.is_object() && there[key].is_object())
            return key + "." + first_difference(there[key], value);
        else if (there[key] != value)
            return key;
    return there.size() == asked.size() ? "" : "number of entries";
}

}  // namespace etalon
