// The cameras' pixel formats in one table with their names in GenICam (PFNC), V4L2 and libcamera,
// and unpacking into code values. Nothing is scaled; a Bayer mosaic stays one; of YUV the luma is
// kept. Layouts: GenICam Pixel Format Naming Convention 2.1; GigE Vision 1.2 (Mono10Packed,
// Mono12Packed); the kernel's "Luma-Only Formats" and "Raw Bayer Formats" (MIPI CSI-2 packing).
#pragma once

#include <cstddef>
#include <span>

#include "core/image/image.h"

namespace etalon {

// How codes lie in memory. Bits are counted from the least significant one of a byte.
enum class PixelPacking {
    bytes,        // one byte a pixel; of NV12 and NM12 the luma's plane
    words_low,    // 16-bit words, the code in the low bits
    words_high,   // 16-bit words, the code in the high bits
    bit_stream,   // PFNC "p": codes one after the other, low bits first, across bytes
    gige_pairs,   // GigE Vision "Packed": high bits | low bits of both | high bits, in 3 bytes
    mipi_csi2,    // the high 8 bits of 4 (10 bits) or 2 (12 bits) pixels, then their low bits
    luma_first,   // YUYV: every other byte, from the first
    luma_second,  // UYVY: every other byte, from the second
    jpeg,         // compressed: pixels are not the sensor's codes
};

struct PixelFormat {
    std::string_view pfnc;        // "Mono12p"; empty where GenICam has no such format
    std::uint32_t pfnc_code = 0;  // 0x010C0047, as in a GigE Vision leader; 0: none
    std::string_view v4l2;        // as people write the four characters: "Y10", "Y16 -BE"
    std::string_view libcamera;   // "R10", as PixelFormat::toString() has it
    PixelPacking packing = PixelPacking::bytes;
    int bits = 8;  // of a code: 8, or 9..16 where the packing holds more than bytes
    Mosaic mosaic = Mosaic::none;
    bool big_endian = false;  // of 16-bit words

    std::string_view name() const { return !pfnc.empty() ? pfnc : v4l2; }
    bool lossy() const { return packing == PixelPacking::jpeg; }
    // Whether its codes are the luma that the camera computed from colours.
    bool luma_of_colours() const {
        return packing == PixelPacking::luma_first || packing == PixelPacking::luma_second ||
               v4l2 == "NV12" || v4l2 == "NM12";
    }
};

// The table. A row may be copied and altered, for 12 bits in the high bits of Mono16 for instance.
std::span<const PixelFormat> pixel_formats();

// Null where the table has none of that name.
const PixelFormat* find_pfnc_format(std::string_view name);
const PixelFormat* find_pfnc_format(std::uint32_t code);
const PixelFormat* find_v4l2_format(std::string_view name);
const PixelFormat* find_libcamera_format(std::string_view name);

// Bytes that the pixels of one line take, without padding; 0 for compressed formats.
std::size_t line_bytes(const PixelFormat& format, int width);

// An image as it came. `bytes_per_line` is the distance of two lines' first bytes; 0 means that
// they follow each other without a gap, which in the formats "p" and "Packed" may be in mid-byte.
struct RawImage {
    std::span<const std::uint8_t> data;
    int width = 0, height = 0;  // px
    std::size_t bytes_per_line = 0;
};

// Bytes that unpack() reads, up to the last pixel of the last line; 0 for compressed formats.
std::size_t image_bytes(const PixelFormat& format, int width, int height,
                        std::size_t bytes_per_line);

// Unpacks into `image`, whose memory is used again where it fits (so pass an empty one if its
// pixels were handed on). Returns what is wrong with the data, for a person, and leaves `image`
// empty then. Codes above the full scale are possible in words_low. Cost: about that of copying; a
// JPEG is decoded (5 ns a pixel), one that ends early is refused, other damage cannot be seen.
[[nodiscard]] std::string unpack(const PixelFormat& format, const RawImage& raw, CodeImage& image);

}  // namespace etalon
