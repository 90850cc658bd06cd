#include "sim/marker/stag_codes.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>

#include "core/file/text.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"
#include "sim/marker/stag_tables.h"

namespace etalon {
namespace {

constexpr StagCode all_bits = (StagCode{1} << stag_bits) - 1;

// The smallest distance of two words over their orientations.
int distance_over_turns(StagCode a, StagCode b) {
    int smallest = stag_bits;
    for (int quarters = 0; quarters < 4; ++quarters)
        smallest = std::min(smallest, hamming_distance(a, turned_stag_code(b, quarters)));
    return smallest;
}

// To itself after a quarter and half a turn (three quarters are as far as one).
int distance_to_itself(StagCode code) {
    return std::min(hamming_distance(code, turned_stag_code(code, 1)),
                    hamming_distance(code, turned_stag_code(code, 2)));
}

// Random words in the generator's fixed order; each that is far enough from those before it stays.
std::vector<StagCode> rotation_safe_codes() {
    constexpr std::size_t count = 128;
    constexpr int distance = 16, min_black = 18, max_black = 30;
    constexpr std::uint64_t key = 16;
    std::vector<StagCode> codes;
    for (std::uint32_t n = 0; codes.size() < count; ++n) {
        const auto words = philox(key, {n, 0, 0, 0});
        const StagCode code = (StagCode{words[1]} << 32 | words[0]) & all_bits;
        const int black = std::popcount(code);
        if (black < min_black || black > max_black || distance_to_itself(code) < distance)
            continue;
        if (std::all_of(codes.begin(), codes.end(), [&](StagCode other) {
                return distance_over_turns(code, other) >= distance;
            }))
            codes.push_back(code);
    }
    return codes;
}

StagCode code_of_line(std::string_view line, const SourcePlace& place) {
    if (line.size() != stag_bits || line.find_first_not_of("01") != std::string_view::npos)
        throw ConfigError(place, fmt::format("a codeword is {} characters 0 or 1", stag_bits));
    StagCode code = 0;
    for (std::size_t i = 0; i < line.size(); ++i)
        if (line[i] == '1')
            code |= StagCode{1} << i;
    return code;
}

std::vector<StagCode> read_codes(const std::string& path) {
    std::vector<StagCode> codes;
    const std::vector<std::string> lines = split(read_text(path), '\n');
    for (std::size_t i = 0; i < lines.size(); ++i) {
        const std::string_view line = trimmed(lines[i]);
        if (!line.empty() && !line.starts_with('#'))
            codes.push_back(code_of_line(line, {path, static_cast<int>(i) + 1, {}}));
    }
    if (codes.empty())
        throw ConfigError({path, 0, {}}, "holds no codeword");
    return codes;
}

}  // namespace

const std::vector<std::string>& stag_families() {
    static const std::vector<std::string> names{"HD17", "HD19", "HD21", "HD23", "R16"};
    return names;
}

bool is_stag_file(const std::string& family) {
    return family.find_first_of("./") != std::string::npos;
}

std::vector<StagCode> stag_codes(const std::string& family) {
    using namespace stag_tables;
    if (is_stag_file(family))
        return read_codes(family);
    if (family == "HD17")
        return {hd17.begin(), hd17.end()};
    if (family == "HD19")
        return {hd19.begin(), hd19.end()};
    if (family == "HD21")
        return {hd21.begin(), hd21.end()};
    if (family == "HD23")
        return {hd23.begin(), hd23.end()};
    if (family != "R16")
        throw ConfigError({}, "no STag family '" + family + "'");
    static const std::vector<StagCode> r16 = rotation_safe_codes();
    return r16;
}

StagCode turned_stag_code(StagCode code, int quarters) {
    const int shift = ((quarters % 4 + 4) % 4) * stag_bits_a_quarter;
    return (code << shift | code >> (stag_bits - shift)) & all_bits;
}

int hamming_distance(StagCode a, StagCode b) {
    return std::popcount(a ^ b);
}

int stag_separation(const std::vector<StagCode>& codes, int id) {
    const StagCode own = codes.at(static_cast<std::size_t>(id));
    int smallest = distance_to_itself(own);
    for (std::size_t other = 0; other < codes.size(); ++other)
        if (other != static_cast<std::size_t>(id))
            smallest = std::min(smallest, distance_over_turns(own, codes[other]));
    return smallest;
}

}  // namespace etalon
