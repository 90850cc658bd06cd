#include "core/config/json_entry.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace etalon {
namespace {

using Json = nlohmann::json;

const Json& json_at(const std::shared_ptr<const void>& json) {
    return *static_cast<const Json*>(json.get());
}

// Owned together with the whole text.
std::shared_ptr<const void> part_of(const std::shared_ptr<const void>& whole, const Json& part) {
    return {whole, &part};
}

std::shared_ptr<const void> parsed(std::string_view text, const SourcePlace& place) {
    const auto json =
        std::make_shared<const Json>(Json::parse(text, nullptr, /*allow_exceptions=*/false));
    if (json->is_discarded())
        throw ConfigError(place, "is not JSON");
    return json;
}

}  // namespace

JsonEntry::JsonEntry(std::string_view text, SourcePlace place)
    : json_(parsed(text, place)), place_(std::move(place)) {}

void JsonEntry::fail(const std::string& message) const {
    throw ConfigError(place_, message);
}

bool JsonEntry::has(const char* key) const {
    return json_at(json_).is_object() && json_at(json_).contains(key);
}

JsonEntry JsonEntry::at(const char* key) const {
    SourcePlace place = place_;
    place.key += place.key.empty() ? key : std::string(".") + key;
    if (!has(key))
        throw ConfigError(place, "is missing");
    return {part_of(json_, json_at(json_)[key]), place};
}

std::vector<std::string> JsonEntry::keys() const {
    if (!json_at(json_).is_object())
        fail("must be an object");
    std::vector<std::string> names;
    for (const auto& [key, value] : json_at(json_).items())
        names.push_back(key);
    return names;
}

void JsonEntry::require_keys(std::initializer_list<const char*> wanted) const {
    for (const char* key : wanted)
        at(key);
    for (const std::string& key : keys())
        if (std::find(wanted.begin(), wanted.end(), key) == wanted.end())
            fail(fmt::format("unknown key '{}'", key));
}

bool JsonEntry::is_null() const {
    return json_at(json_).is_null();
}

std::vector<JsonEntry> JsonEntry::items() const {
    if (!json_at(json_).is_array())
        fail("must be a list");
    std::vector<JsonEntry> list;
    for (std::size_t i = 0; i < json_at(json_).size(); ++i) {
        SourcePlace place = place_;
        place.key += fmt::format("[{}]", i);
        list.push_back({part_of(json_, json_at(json_)[i]), place});
    }
    return list;
}

double JsonEntry::number(Range range) const {
    if (!json_at(json_).is_number())
        fail("must be a number");
    const double value = json_at(json_).get<double>();
    if (!std::isfinite(value) || !range.contains(value))
        fail(fmt::format("{} is out of range", value));
    return value;
}

long long JsonEntry::integer(long long low, long long high) const {
    constexpr auto largest = static_cast<std::uint64_t>(std::numeric_limits<long long>::max());
    const bool wraps =
        json_at(json_).is_number_unsigned() && json_at(json_).get<std::uint64_t>() > largest;
    if (!json_at(json_).is_number_integer() || wraps || json_at(json_).get<long long>() < low ||
        json_at(json_).get<long long>() > high)
        fail(fmt::format("must be a whole number from {} to {}", low, high));
    return json_at(json_).get<long long>();
}

std::uint64_t JsonEntry::whole() const {
    if (!json_at(json_).is_number_unsigned())
        fail("must be a whole number");
    return json_at(json_).get<std::uint64_t>();
}

bool JsonEntry::flag() const {
    if (!json_at(json_).is_boolean())
        fail("must be true or false");
    return json_at(json_).get<bool>();
}

std::string JsonEntry::text() const {
    if (!json_at(json_).is_string())
        fail("must be text");
    return printable(json_at(json_).get<std::string>());
}

std::string JsonEntry::line() const {
    const std::string shown = text();
    if (shown != json_at(json_).get<std::string>())
        fail(fmt::format("must be a line of text: '{}' holds a control character", shown));
    return shown;
}

std::vector<double> JsonEntry::numbers(std::size_t count, Range range) const {
    std::vector<double> values;
    for (const JsonEntry& item : items())
        values.push_back(item.number(range));
    if (values.size() != count)
        fail(fmt::format("must be {} numbers, not {}", count, values.size()));
    return values;
}

}  // namespace etalon
