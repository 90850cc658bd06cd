// Where the chunks of a GenICam payload lie. In chunk mode a device sends its image and what it
// says of it as chunks one after the other: the data of each, then its id and its length in bytes,
// 4 bytes each, big-endian with GigE Vision and little-endian with USB3 Vision. Only the end of the
// payload is known, so they are read backwards. The image is the first of them; some devices send
// it without id and length. What the chunks mean is in genicam_chunks.h.
//
// Lengths come from a device and over a network: nothing outside the payload is ever touched.
#pragma once

#include <bit>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace etalon {

struct Chunk {
    std::uint32_t id = 0;
    std::span<const std::uint8_t> data;
};

struct PayloadParts {
    std::span<const std::uint8_t> image;  // all of it where there are no chunks
    std::vector<Chunk> chunks;            // the last in the payload comes first

    // Null where there is none of that id; of several, the last in the payload.
    const Chunk* find(std::uint32_t id) const;
};

// `image_bytes` is what the image should have, to know an image without id and length; the image
// that is found may have another size. Returns what is wrong, for a person to read; then `parts` is
// of no use. Nothing when the chunks fill the payload exactly.
[[nodiscard]] std::string split_payload(std::span<const std::uint8_t> payload,
                                        std::size_t image_bytes, std::endian order,
                                        PayloadParts& parts);

}  // namespace etalon
