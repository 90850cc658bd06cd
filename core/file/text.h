// Small text helpers for reading what people type and for writing files that are never half there.
#pragma once

#include <cstdint>
#include <fstream>
#include <string_view>
#include <vector>

#include "core/program/errors.h"

namespace etalon {

// The whole of `text` as a finite number, independent of the locale; nothing if it is not one.
std::optional<double> parse_number(std::string_view text);
std::optional<long long> parse_integer(std::string_view text);

// "1,2.5,-3" with exactly `count` numbers. Throws ConfigError at `place` otherwise.
std::vector<double> parse_numbers(std::string_view text, std::size_t count,
                                  const std::string& place);

std::string_view trimmed(std::string_view text);
std::vector<std::string> split(std::string_view text, char separator);

// "; a decimal point is a dot: 1.5" for "1,5"; empty for what is no such number.
std::string number_hint(std::string_view text);

// The candidate that `word` was most likely meant to be, first one that it begins; empty if none is
// near.
std::string nearest_word(std::string_view word, const std::vector<std::string>& candidates);

// A number with enough digits to be read back as the same double, and no more.
std::string exact(double value);

// `line` and the words after it, continued on further lines from column `indent` on where they
// would be longer than `columns`. Ends with a line end; no line ends with a space.
std::string wrapped_words(std::string line, const std::vector<std::string>& words,
                          const std::string& separator, std::size_t indent,
                          std::size_t columns = 79);

// The text's words after `head`, further lines below its text.
std::string wrapped_text(const std::string& head, std::string_view text, std::size_t columns = 79);

// Why there is no regular file to read: "no such file", "is a folder, not a file"; empty where one
// is. Links are followed.
std::string no_file_cause(const std::filesystem::path& path);
// Throws ConfigError with that cause.
void require_file(const std::filesystem::path& path);

// Whole file as text, without the byte order mark that some programs put before it. Throws
// ConfigError when it cannot be read, is larger than 64 MiB, or is not UTF-8.
std::string read_text(const std::filesystem::path& path);

// Its parts, for what reads a file piece by piece. Opening throws ConfigError for what is no
// regular file, is larger than `most_bytes`, or cannot be read.
inline constexpr std::uintmax_t max_text_bytes = 64u << 20;  // of what is held in memory
std::ifstream open_text(const std::filesystem::path& path, std::uintmax_t most_bytes);
void remove_byte_order_mark(std::string& text);

// Throws ConfigError with the line, `place` being that of the text's first one, at a byte that is
// not UTF-8 (Unicode 15, table 3-7) or is zero, which would end the text for some libraries.
void require_utf8(std::string_view text, SourcePlace place);

// Replaces the file in one step: readers see the old or the new text, never a part.
void write_text(const std::filesystem::path& path, std::string_view text);

// The folder and those above it, where they are missing. Throws ConfigError when it cannot be made.
void make_folder(const std::filesystem::path& folder);

// Escapes &, <, >, quotes, and control characters but line ends, for HTML and SVG.
std::string escape_html(std::string_view text);

}  // namespace etalon
