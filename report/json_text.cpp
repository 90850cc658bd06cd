#include "report/json_text.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/config/yaml_text.h"
#include "core/file/text.h"

namespace etalon {

Json read_json(const std::filesystem::path& path) {
    const auto require_depth = [&](int depth, Json::parse_event_t, Json&) {
        if (depth > static_cast<int>(max_yaml_depth))
            throw ConfigError(
                {path.string()},
                fmt::format("has more than {} lists and objects in each other", max_yaml_depth));
        return true;
    };
    return Json::parse(read_text(path), require_depth, /*allow_exceptions=*/false);
}

std::string text_of(const Json& json, int indent) {
    return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

Json software_json(std::span<const SoftwareVersion> software) {
    Json json;
    for (const SoftwareVersion& each : software)
        json[each.name] = each.version;
    return json;
}

std::string first_difference(const Json& there, const Json& asked) {
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
