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

}  // namespace etalon
