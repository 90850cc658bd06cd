// One value of a JSON text with its place, read strictly: what is missing, of another type, not
// finite or out of range is a ConfigError with file, line and dotted key. For the records that this
// program wrote itself and reads back (core/strict_reader.h is for what people write).
//
// Includes json.hpp, which takes seconds to compile: for .cpp files only.
#pragma once

#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "core/errors.h"
#include "core/strict_reader.h"

namespace etalon {

// Does not own the JSON: it must outlive the entry.
class JsonEntry {
public:
    JsonEntry(const nlohmann::json& json, SourcePlace place)
        : json_(&json), place_(std::move(place)) {}

    // Of an object: a required key; whether there is one.
    JsonEntry at(const char* key) const;
    bool has(const char* key) const;
    // Throws unless the object has these keys and no other.
    void require_keys(std::initializer_list<const char*> keys) const;
    std::vector<std::string> keys() const;

    // Of a list.
    std::vector<JsonEntry> items() const;

    bool is_null() const { return json_->is_null(); }
    double number(Range range = any_number) const;
    long long integer(long long low, long long high) const;
    std::uint64_t whole() const;
    bool flag() const;
    std::string text() const;
    // A list of exactly `count` numbers.
    std::vector<double> numbers(std::size_t count, Range range = any_number) const;

    const SourcePlace& place() const { return place_; }
    [[noreturn]] void fail(const std::string& message) const;

private:
    const nlohmann::json* json_;
    SourcePlace place_;
};

// A whole text as JSON. Throws ConfigError at `place` when it is none.
nlohmann::json parse_json(std::string_view text, const SourcePlace& place);

}  // namespace etalon
