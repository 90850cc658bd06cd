// One value of a JSON text, read strictly: ConfigErrors with file, line and dotted key. For records
// that this program wrote itself (core/config/strict_reader.h is for what people write).
#pragma once

#include <cstdint>

#include "core/config/strict_reader.h"

namespace etalon {

// Cheap to copy; keeps its text alive.
class JsonEntry {
public:
    // A whole text. Throws ConfigError at `place` when it is no JSON.
    JsonEntry(std::string_view text, SourcePlace place);

    // Of an object: a required key; whether there is one.
    JsonEntry at(const char* key) const;
    bool has(const char* key) const;
    // Throws unless the object has these keys and no other.
    void require_keys(std::initializer_list<const char*> keys) const;
    std::vector<std::string> keys() const;

    // Of a list.
    std::vector<JsonEntry> items() const;

    bool is_null() const;
    double number(Range range = any_number) const;
    long long integer(long long low, long long high) const;
    std::uint64_t whole() const;
    bool flag() const;
    std::string text() const;  // printable(), whoever wrote it
    std::string line() const;  // of a request: refused where that is another text
    // A list of exactly `count` numbers.
    std::vector<double> numbers(std::size_t count, Range range = any_number) const;

    const SourcePlace& place() const { return place_; }
    [[noreturn]] void fail(const std::string& message) const;

private:
    JsonEntry(std::shared_ptr<const void> json, SourcePlace place)
        : json_(std::move(json)), place_(std::move(place)) {}

    std::shared_ptr<const void> json_;  // nlohmann's, which headers do not include
    SourcePlace place_;
};

}  // namespace etalon
