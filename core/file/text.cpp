#include "core/file/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <sstream>

#include "core/file/file_writing.h"

namespace etalon {
namespace {

std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < a.size(); ++i) {
        std::size_t diagonal = row[0];
        row[0] = i + 1;
        for (std::size_t j = 0; j < b.size(); ++j) {
            const std::size_t substitution = diagonal + (a[i] == b[j] ? 0 : 1);
            diagonal = row[j + 1];
            row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, substitution});
        }
    }
    return row.back();
}

template <class Number>
std::optional<Number> parse_whole(std::string_view text) {
    text = trimmed(text);
    if (text.starts_with('+') && !text.starts_with("+-"))
        text.remove_prefix(1);
    Number value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc{} || end != text.data() + text.size())
        return std::nullopt;
    return value;
}

// Bytes of the UTF-8 character that the text begins with; 0 if it begins with none.
std::size_t character_bytes(std::string_view text) {
    const auto byte = [&](std::size_t i) {
        return i < text.size() ? static_cast<unsigned char>(text[i]) : 0u;
    };
    const unsigned first = byte(0);
    if (first > 0 && first < 0x80)
        return 1;
    if (first < 0xc2 || first > 0xf4)
        return 0;
    const unsigned low = first == 0xe0 ? 0xa0 : first == 0xf0 ? 0x90 : 0x80;
    const unsigned high = first == 0xed ? 0x9f : first == 0xf4 ? 0x8f : 0xbf;
    if (byte(1) < low || byte(1) > high)
        return 0;
    const std::size_t bytes = first < 0xe0 ? 2 : first < 0xf0 ? 3 : 4;
    for (std::size_t i = 2; i < bytes; ++i)
        if (byte(i) < 0x80 || byte(i) > 0xbf)
            return 0;
    return bytes;
}

}  // namespace

void require_utf8(std::string_view text, SourcePlace place) {
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t bytes = character_bytes(text.substr(at));
        if (bytes == 0) {
            const auto byte = static_cast<unsigned char>(text[at]);
            throw ConfigError(place, fmt::format("is not UTF-8: a byte 0x{:02x}", byte));
        }
        place.line += text[at] == '\n';
        at += bytes;
    }
}

std::optional<double> parse_number(std::string_view text) {
    const auto value = parse_whole<double>(text);
    return value && std::isfinite(*value) ? value : std::nullopt;
}

std::optional<long long> parse_integer(std::string_view text) {
    return parse_whole<long long>(text);
}

std::string number_hint(std::string_view text) {
    const std::size_t comma = text.find(',');
    std::string dotted(text);
    if (comma != std::string_view::npos)
        dotted[comma] = '.';
    const bool is_meant = comma != std::string_view::npos && parse_number(dotted);
    return is_meant ? "; a decimal point is a dot: " + dotted : "";
}

std::vector<double> parse_numbers(std::string_view text, std::size_t count,
                                  const std::string& place) {
    std::vector<double> numbers;
    for (const std::string& part : split(text, ',')) {
        const auto number = parse_number(part);
        if (!number)
            throw ConfigError({place}, fmt::format("'{}' is not a finite number", part));
        numbers.push_back(*number);
    }
    if (numbers.size() != count)
        throw ConfigError({place}, fmt::format("expected {} numbers separated by commas, with dots "
                                               "as decimal points, got {}",
                                               count, numbers.size()));
    return numbers;
}

std::string_view trimmed(std::string_view text) {
    constexpr std::string_view blanks = " \t\r\n";
    const auto first = text.find_first_not_of(blanks);
    if (first == std::string_view::npos)
        return {};
    return text.substr(first, text.find_last_not_of(blanks) - first + 1);
}

std::vector<std::string> split(std::string_view text, char separator) {
    std::vector<std::string> parts;
    for (std::size_t begin = 0;;) {
        const auto end = text.find(separator, begin);
        parts.emplace_back(text.substr(begin, end - begin));
        if (end == std::string_view::npos)
            return parts;
        begin = end + 1;
    }
}

std::string nearest_word(std::string_view word, const std::vector<std::string>& candidates) {
    std::string nearest;
    std::size_t best = word.size() / 2 + 2;  // farther than that is no misspelling
    for (const std::string& candidate : candidates) {
        const bool is_begun = !word.empty() && candidate.starts_with(word);
        const std::size_t distance = is_begun ? 0 : edit_distance(word, candidate);
        if (distance < best) {
            best = distance;
            nearest = candidate;
        }
    }
    return nearest;
}

std::string exact(double value) {
    return fmt::format("{}", value);
}

std::string wrapped_words(std::string line, const std::vector<std::string>& words,
                          const std::string& separator, std::size_t indent, std::size_t columns) {
    std::string text;
    const auto end_line = [&](std::string ended) {
        ended.erase(ended.find_last_not_of(' ') + 1);
        text += ended + "\n";
    };
    for (std::size_t i = 0; i < words.size(); ++i) {
        const std::string before = i == 0 ? "" : separator;
        if (line.size() + before.size() + words[i].size() > columns && line.size() > indent) {
            end_line(line + before);
            line = std::string(indent, ' ') + words[i];
        } else {
            line += before + words[i];
        }
    }
    end_line(line);
    return text;
}

std::string wrapped_text(const std::string& head, std::string_view text, std::size_t columns) {
    return wrapped_words(head, split(text, ' '), " ", head.size(), columns);
}

std::string no_file_cause(const std::filesystem::path& path) {
    using enum std::filesystem::file_type;
    std::error_code error;
    switch (std::filesystem::status(path, error).type()) {
        case regular:
            return "";
        case not_found:
            return "no such file";
        case directory:
            return "is a folder, not a file";
        case fifo:
            return "is a FIFO, not a file";
        case socket:
            return "is a socket, not a file";
        case block:
        case character:
            return "is a device, not a file";
        default:
            return "cannot be read: " +
                   error.message();  // a loop of links, a folder without access
    }
}

void require_file(const std::filesystem::path& path) {
    if (const std::string cause = no_file_cause(path); !cause.empty())
        throw ConfigError({path.string()}, cause);
}

std::ifstream open_text(const std::filesystem::path& path, std::uintmax_t most_bytes) {
    std::error_code error;
    require_file(path);
    if (std::filesystem::file_size(path, error) > most_bytes)
        throw ConfigError({path.string()}, fmt::format("is larger than {} MiB", most_bytes >> 20));
    std::ifstream file(path, std::ios::binary);
    if (!file)
        throw ConfigError({path.string()}, "cannot be read");
    note_input(path);
    return file;
}

void remove_byte_order_mark(std::string& text) {
    constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";
    if (text.starts_with(byte_order_mark))
        text.erase(0, byte_order_mark.size());
}

std::string read_text(const std::filesystem::path& path) {
    const std::ifstream file = open_text(path, max_text_bytes);
    std::ostringstream text;
    text << file.rdbuf();
    if (!file)
        throw ConfigError({path.string()}, "cannot be read");
    std::string whole = std::move(text).str();
    remove_byte_order_mark(whole);
    require_utf8(whole, {path.string(), 1});
    return whole;
}

void write_text(const std::filesystem::path& path, std::string_view text) {
    AtomicFile file(path);
    file.write(text);
    file.commit();
}

void make_folder(const std::filesystem::path& folder) {
    std::error_code failure;
    std::filesystem::create_directories(folder, failure);
    if (failure)
        fail_writing(folder, failure);
}

std::string escape_html(std::string_view text) {
    std::string escaped;
    for (const char c : printable(text, "\n"))
        escaped += c == '&'   ? "&amp;"
                   : c == '<' ? "&lt;"
                   : c == '>' ? "&gt;"
                   : c == '"' ? "&quot;"
                              : std::string(1, c);
    return escaped;
}

}  // namespace etalon
