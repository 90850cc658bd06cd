#include "report/json_text.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/config/yaml_text.h"
#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {

using nlohmann::ordered_json;

ordered_json read_json(const std::filesystem::path& path) {
    const auto require_depth = [&](int depth, ordered_json::parse_event_t, ordered_json&) {
        if (depth > static_cast<int>(max_yaml_depth))
            throw ConfigError(
                {path.string()},
                fmt::format("has more than {} lists and objects in each other", max_yaml_depth));
        return true;
    };
    return ordered_json::parse(read_text(path), require_depth, /*allow_exceptions=*/false);
}

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
