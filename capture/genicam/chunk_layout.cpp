#include "capture/genicam/chunk_layout.h"

#include <fmt/format.h>

#include <algorithm>

namespace etalon {
namespace {

constexpr std::size_t tag_bytes = 8;     // id and length
constexpr std::size_t max_chunks = 256;  // devices have about twenty

std::uint32_t number(std::span<const std::uint8_t> bytes, std::endian order) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < 4; ++i)
        value = value << 8 | bytes[order == std::endian::big ? i : 3 - i];
    return value;
}

}  // namespace

const Chunk* PayloadParts::find(std::uint32_t id) const {
    const auto found = std::find_if(chunks.begin(), chunks.end(),
                                    [&](const Chunk& each) { return each.id == id; });
    return found == chunks.end() ? nullptr : &*found;
}

std::string split_payload(std::span<const std::uint8_t> payload, std::size_t image_bytes,
                          std::endian order, PayloadParts& parts) {
    parts = {};
    std::size_t end = payload.size();
    while (end != 0 && end != image_bytes) {
        if (end < tag_bytes)
            return fmt::format("{} bytes are left over before its chunks", end);
        if (parts.chunks.size() == max_chunks)
            return fmt::format("it has more than {} chunks", max_chunks);
        const std::size_t before = end - tag_bytes;
        const std::uint32_t id = number(payload.subspan(before, 4), order);
        const std::size_t length = number(payload.subspan(before + 4, 4), order);
        if (length > before)
            return fmt::format("its chunk {:#x} has a length of {} bytes, {} are there", id, length,
                               before);
        end = before - length;
        parts.chunks.push_back({id, payload.subspan(end, length)});
    }
    parts.image = payload.first(end);
    if (end == 0 && !parts.chunks.empty()) {
        parts.image = parts.chunks.back().data;
        parts.chunks.pop_back();
    }
    return "";
}

}  // namespace etalon
