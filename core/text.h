// Small text helpers for reading what people type and for writing files that are never half there.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace etalon {

// The whole of `text` as a finite number, independent of the locale; nothing if it is not one.
std::optional<double> parse_number(std::string_view text);
std::optional<long long> parse_integer(std::string_view text);

// "1,2.5,-3" with exactly `count` numbers. Throws ConfigError at `place` otherwise.
std::vector<double> parse_numbers(std::string_view text, std::size_t count,
                                  const std::string& place);

std::string_view trimmed(std::string_view text);
std::vector<std::string> split(std::string_view text, char separator);

// The candidate that `word` was most likely meant to be; empty if none is near.
std::string nearest_word(std::string_view word, const std::vector<std::string>& candidates);

// A number with enough digits to be read back as the same double, and no more.
std::string exact(double value);

// Whole file as text. Throws ConfigError when it cannot be read or is larger than 64 MiB.
std::string read_text(const std::filesystem::path& path);

// Replaces the file in one step: readers see the old or the new text, never a part.
void write_text(const std::filesystem::path& path, std::string_view text);

// Escapes &, <, >, and quotes for HTML and SVG.
std::string escape_html(std::string_view text);

}  // namespace etalon
