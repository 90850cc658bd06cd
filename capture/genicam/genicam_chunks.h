// What a frame of a GenICam device says of itself in chunks (names of SFNC 2): exposure time, gain,
// time stamp, number. Aravis' parser evaluates them by the device's description but trusts every
// length: the layout is checked before, and only plain values without selectors are used.
#pragma once

#include <bit>
#include <span>

#include "capture/genicam/genicam_device.h"

typedef struct _ArvChunkParser ArvChunkParser;
typedef struct _ArvBuffer ArvBuffer;

namespace etalon {

// A chunk is its data, then id and length, 4 bytes each, big-endian with GigE Vision, little-endian
// with USB3 Vision. Only the payload's end is known: they are read backwards. The image is the
// first, from some devices without id and length. Nothing outside the payload is ever touched.
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

// As far as the device says.
struct ChunkValues {
    std::optional<double> exposure_us, gain_db;
    std::optional<std::uint64_t> time_ns, frame_id;
};

// A value, and what of which chunks it is made from.
struct ChunkField {
    struct Source {
        std::uint32_t id;
        std::size_t bytes;  // that the chunk needs at least
    };
    std::string feature;  // "ChunkExposureTime"
    std::vector<Source> sources;
    bool whole = false;                // a whole number
    std::uint64_t ticks_a_second = 0;  // of a time stamp; 0: it counts nanoseconds
};

struct GenicamChunks {
    bool active = false;  // whether the device sends chunks
    std::vector<ChunkField> fields;
    std::shared_ptr<ArvChunkParser> parser;
};

// Chunk mode is on afterwards if the device has one of the values that are of use, else off, unless
// it will not be switched off: ask. Throw DeviceError when the device does not answer.
GenicamChunks switch_chunks_on(const GenicamDevice& device);
bool chunks_are_on(const GenicamDevice& device);

// Whether the library can read the chunks of this buffer's payload type.
bool chunks_are_readable(ArvBuffer* buffer);

// The values of a frame whose chunks are in `parts`. Returns what is wrong: a chunk that is
// missing, too short or cannot be evaluated; empty if nothing.
[[nodiscard]] std::string read_chunks(const GenicamChunks& chunks, ArvBuffer* buffer,
                                      const PayloadParts& parts, ChunkValues& values);

// What of a frame is not as the settings say, in words; empty if nothing. The exposure may differ
// by `exposure_step_us`, 1 us or a thousandth, the gain by 0.05 dB.
std::string contradiction(const ChunkValues& values, const CaptureSettings& settings,
                          double exposure_step_us);

}  // namespace etalon
