// JSON of files and --json: keys in the order in which they are written. Cheap to include; a .cpp
// file that makes JSON includes <nlohmann/json.hpp>, which takes a second.
#pragma once

#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>

#include "report/software_versions.h"

namespace etalon {

using Json = nlohmann::ordered_json;

// A file of ours, read back; discarded when it is no JSON. Throws ConfigError when it cannot be
// read, or has more lists and objects in each other than max_yaml_depth (core/config/yaml_text.h):
// comparing or writing what is as deep as a file can be takes more stack than there is.
Json read_json(const std::filesystem::path& path);

// Bytes that are not UTF-8 are replaced. `indent` -1: on one line. No line end behind it.
std::string text_of(const Json& json, int indent = 2);

// null without a value; nlohmann writes NaN and infinity as null by itself.
template <class Value, class Object = Json>
Object or_null(const std::optional<Value>& value) {
    return value ? Object(*value) : Object();
}

// Makes to_json() of a type, in namespace etalon, for keys that are the names of its members.
#define ETALON_MEMBERS_TO_JSON(Type, ...)                                        \
    inline void to_json(Json& nlohmann_json_j, const Type& nlohmann_json_t) {    \
        NLOHMANN_JSON_EXPAND(NLOHMANN_JSON_PASTE(NLOHMANN_JSON_TO, __VA_ARGS__)) \
    }

// An array of what `json_of` makes of each.
template <class List, class Function, class Array = Json>
Array json_list(const List& list, Function json_of) {
    Array array = Array::array();
    for (const auto& each : list)
        array.push_back(json_of(each));
    return array;
}

// Adds what there is, as `json_of` makes it; an optional without a value gets no key.
template <class Object, class Value, class Function = std::identity>
void add_present(Object& json, const char* key, const std::optional<Value>& value,
                 Function json_of = {}) {
    if (value)
        json[key] = json_of(*value);
}

Json software_json(std::span<const SoftwareVersion> software);

// The first entry in which two objects differ, its path inside; empty if none does.
std::string first_difference(const Json& there, const Json& asked);

}  // namespace etalon
