#include "report/shard.h"

#include "core/file/text.h"
#include "core/program/errors.h"

namespace etalon {

Shard parse_shard(const std::string& text) {
    if (text.empty())
        return {};
    const std::vector<std::string> parts = split(text, '/');
    const auto index = parts.size() == 2 ? parse_integer(parts[0]) : std::nullopt;
    const auto count = parts.size() == 2 ? parse_integer(parts[1]) : std::nullopt;
    if (!index || !count || *index < 1 || *index > *count || *count > 1'000'000)
        throw ConfigError({"--shard"}, "must be I/N with 1 <= I <= N, not '" + text + "'");
    return {static_cast<std::size_t>(*index), static_cast<std::size_t>(*count)};
}

}  // namespace etalon
