// JSON as the files and --json of the commands have it: keys in the order in which they are
// written. Cheap to include; a .cpp file that makes JSON includes <nlohmann/json.hpp>, which takes
// a second.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>

#include "report/software_versions.h"

namespace etalon {

// A file of ours, read back; discarded when it is no JSON. Throws ConfigError when it cannot be
// read, or has more lists and objects in each other than max_yaml_depth (core/config/yaml_text.h):
// comparing or writing what is as deep as a file can be takes more stack than there is.
nlohmann::ordered_json read_json(const std::filesystem::path& path);

// Bytes that are not UTF-8 are replaced. `indent` -1: on one line. No line end behind it.
std::string text_of(const nlohmann::ordered_json& json, int indent = 2);

// null without a value; nlohmann writes NaN and infinity as null by itself.
nlohmann::ordered_json optional_number(const std::optional<double>& value);

// An array of what `json_of` makes of each.
template <class List, class Function, class Json = nlohmann::ordered_json>
Json json_list(const List& list, Function json_of) {
    Json array = Json::array();
    for (const auto& each : list)
        array.push_back(json_of(each));
    return array;
}

nlohmann::ordered_json software_json(std::span<const SoftwareVersion> software);

// The first entry in which two objects differ, its path inside; empty if none does.
std::string first_difference(const nlohmann::ordered_json& there,
                             const nlohmann::ordered_json& asked);

}  // namespace etalon
