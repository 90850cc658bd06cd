// JSON as the files and --json of the commands have it: keys in the order in which they are
// written. Cheap to include; a .cpp file that makes JSON includes <nlohmann/json.hpp>, which takes
// a second.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace etalon {

// Bytes that are not UTF-8 are replaced. `indent` -1: on one line. No line end behind it.
std::string text_of(const nlohmann::ordered_json& json, int indent = 2);

// null without a value; nlohmann writes NaN and infinity as null by itself.
nlohmann::ordered_json optional_number(const std::optional<double>& value);

}  // namespace etalon
