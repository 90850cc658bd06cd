#include "capture/frame/pixel_formats.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "core/image/picture_codec.h"
#include "core/program/errors.h"

namespace etalon {
namespace {

static_assert(std::endian::native == std::endian::little, "words are copied as they are");

using enum PixelPacking;

// PFNC name and code, V4L2, libcamera, packing, bits, mosaic, big-endian
constexpr PixelFormat formats[] = {
    {"Mono8", 0x01080001, "GREY", "R8", bytes, 8, Mosaic::none, false},
    {"Mono10", 0x01100003, "Y10", "R10", words_low, 10, Mosaic::none, false},
    {"Mono12", 0x01100005, "Y12", "R12", words_low, 12, Mosaic::none, false},
    {"Mono16", 0x01100007, "Y16", "R16", words_low, 16, Mosaic::none, false},
    {"", 0, "Y16 -BE", "", words_low, 16, Mosaic::none, true},
    {"", 0, "Y012", "", words_high, 12, Mosaic::none, false},
    {"Mono10p", 0x010A0046, "", "", bit_stream, 10, Mosaic::none, false},
    {"Mono12p", 0x010C0047, "", "", bit_stream, 12, Mosaic::none, false},
    {"Mono10Packed", 0x010C0004, "", "", gige_pairs, 10, Mosaic::none, false},
    {"Mono12Packed", 0x010C0006, "", "", gige_pairs, 12, Mosaic::none, false},
    {"", 0, "Y10P", "R10_CSI2P", mipi_csi2, 10, Mosaic::none, false},
    {"", 0, "Y12P", "R12_CSI2P", mipi_csi2, 12, Mosaic::none, false},
    {"YUV422_8", 0x02100032, "YUYV", "YUYV", luma_first, 8, Mosaic::none, false},
    {"YUV422_8_UYVY", 0x0210001F, "UYVY", "UYVY", luma_second, 8, Mosaic::none, false},
    {"", 0, "NV12", "NV12", bytes, 8, Mosaic::none, false},
    {"", 0, "NM12", "", bytes, 8, Mosaic::none, false},
    {"", 0, "MJPG", "MJPEG", jpeg, 8, Mosaic::none, false},

    {"BayerRG8", 0x01080009, "RGGB", "SRGGB8", bytes, 8, Mosaic::rggb, false},
    {"BayerGR8", 0x01080008, "GRBG", "SGRBG8", bytes, 8, Mosaic::grbg, false},
    {"BayerGB8", 0x0108000A, "GBRG", "SGBRG8", bytes, 8, Mosaic::gbrg, false},
    {"BayerBG8", 0x0108000B, "BA81", "SBGGR8", bytes, 8, Mosaic::bggr, false},
    {"BayerRG10", 0x0110000D, "RG10", "SRGGB10", words_low, 10, Mosaic::rggb, false},
    {"BayerGR10", 0x0110000C, "BA10", "SGRBG10", words_low, 10, Mosaic::grbg, false},
    {"BayerGB10", 0x0110000E, "GB10", "SGBRG10", words_low, 10, Mosaic::gbrg, false},
    {"BayerBG10", 0x0110000F, "BG10", "SBGGR10", words_low, 10, Mosaic::bggr, false},
    {"BayerRG12", 0x01100011, "RG12", "SRGGB12", words_low, 12, Mosaic::rggb, false},
    {"BayerGR12", 0x01100010, "BA12", "SGRBG12", words_low, 12, Mosaic::grbg, false},
    {"BayerGB12", 0x01100012, "GB12", "SGBRG12", words_low, 12, Mosaic::gbrg, false},
    {"BayerBG12", 0x01100013, "BG12", "SBGGR12", words_low, 12, Mosaic::bggr, false},
    {"BayerRG10p", 0x010A0058, "", "", bit_stream, 10, Mosaic::rggb, false},
    {"BayerGR10p", 0x010A0056, "", "", bit_stream, 10, Mosaic::grbg, false},
    {"BayerGB10p", 0x010A0054, "", "", bit_stream, 10, Mosaic::gbrg, false},
    {"BayerBG10p", 0x010A0052, "", "", bit_stream, 10, Mosaic::bggr, false},
    {"BayerRG12p", 0x010C0059, "", "", bit_stream, 12, Mosaic::rggb, false},
    {"BayerGR12p", 0x010C0057, "", "", bit_stream, 12, Mosaic::grbg, false},
    {"BayerGB12p", 0x010C0055, "", "", bit_stream, 12, Mosaic::gbrg, false},
    {"BayerBG12p", 0x010C0053, "", "", bit_stream, 12, Mosaic::bggr, false},
    {"BayerRG10Packed", 0x010C0027, "", "", gige_pairs, 10, Mosaic::rggb, false},
    {"BayerGR10Packed", 0x010C0026, "", "", gige_pairs, 10, Mosaic::grbg, false},
    {"BayerGB10Packed", 0x010C0028, "", "", gige_pairs, 10, Mosaic::gbrg, false},
    {"BayerBG10Packed", 0x010C0029, "", "", gige_pairs, 10, Mosaic::bggr, false},
    {"BayerRG12Packed", 0x010C002B, "", "", gige_pairs, 12, Mosaic::rggb, false},
    {"BayerGR12Packed", 0x010C002A, "", "", gige_pairs, 12, Mosaic::grbg, false},
    {"BayerGB12Packed", 0x010C002C, "", "", gige_pairs, 12, Mosaic::gbrg, false},
    {"BayerBG12Packed", 0x010C002D, "", "", gige_pairs, 12, Mosaic::bggr, false},
    {"", 0, "pRAA", "SRGGB10_CSI2P", mipi_csi2, 10, Mosaic::rggb, false},
    {"", 0, "pgAA", "SGRBG10_CSI2P", mipi_csi2, 10, Mosaic::grbg, false},
    {"", 0, "pGAA", "SGBRG10_CSI2P", mipi_csi2, 10, Mosaic::gbrg, false},
    {"", 0, "pBAA", "SBGGR10_CSI2P", mipi_csi2, 10, Mosaic::bggr, false},
    {"", 0, "pRCC", "SRGGB12_CSI2P", mipi_csi2, 12, Mosaic::rggb, false},
    {"", 0, "pgCC", "SGRBG12_CSI2P", mipi_csi2, 12, Mosaic::grbg, false},
    {"", 0, "pGCC", "SGBRG12_CSI2P", mipi_csi2, 12, Mosaic::gbrg, false},
    {"", 0, "pBCC", "SBGGR12_CSI2P", mipi_csi2, 12, Mosaic::bggr, false},
};

// A field of the table, looked up; empty and 0 stand for "none" and are never found.
template <class Key>
const PixelFormat* find(Key PixelFormat::*field, const Key& key) {
    const auto found = std::find_if(std::begin(formats), std::end(formats),
                                    [&](const PixelFormat& f) { return f.*field == key; });
    return key == Key{} || found == std::end(formats) ? nullptr : found;
}

// ---- packed pixels: four at a time, moved into the four 16-bit lanes of a 64-bit word ----------

using Word = std::uint64_t;

template <std::size_t count>
Word load(const std::uint8_t* in) {
    static_assert(count > 4 && count <= 8);
    std::uint32_t low = 0, high = 0;
    std::memcpy(&low, in, 4);
    std::memcpy(&high, in + 4, count - 4);
    return low | Word{high} << 32;
}

// Six bytes, the first three of them in the low half of the word and the others in the high one.
Word load_pairs(const std::uint8_t* in) {
    const Word word = load<6>(in);
    return (word & 0xFF'FF'FF) | (word & 0xFF'FF'FF'00'00'00) << 8;
}

// Both halves of a word.
constexpr Word both(std::uint32_t half) {
    return half | Word{half} << 32;
}

Word bit_stream_10(const std::uint8_t* in) {
    const Word word = load<5>(in);
    constexpr Word ten_bits = 0x3FF;
    return (word & ten_bits) | (word & ten_bits << 10) << 6 | (word & ten_bits << 20) << 12 |
           (word & ten_bits << 30) << 18;
}

Word bit_stream_12(const std::uint8_t* in) {
    const Word word = load_pairs(in);
    return (word & both(0x000FFF)) | (word & both(0xFFF000)) << 4;
}

Word gige_pairs_10(const std::uint8_t* in) {
    const Word word = load_pairs(in);
    return (word & both(0xFF00FF)) << 2 | (word & both(0x000300)) >> 8 |
           (word & both(0x003000)) << 4;
}

Word gige_pairs_12(const std::uint8_t* in) {
    const Word word = load_pairs(in);
    return (word & both(0xFF00FF)) << 4 | (word & both(0x000F00)) >> 8 |
           (word & both(0x00F000)) << 4;
}

Word mipi_10(const std::uint8_t* in) {
    const Word word = load<5>(in), low = in[4];
    return (word & 0xFF) << 2 | (word & 0xFF00) << 10 | (word & 0xFF0000) << 18 |
           (word & 0xFF000000) << 26 | (low & 0x03) | (low & 0x0C) << 14 | (low & 0x30) << 28 |
           (low & 0xC0) << 42;
}

Word mipi_12(const std::uint8_t* in) {
    const Word word = load_pairs(in);
    return (word & both(0x0000FF)) << 4 | (word & both(0x0F0000)) >> 16 |
           (word & both(0x00FF00)) << 12 | (word & both(0xF00000)) >> 4;
}

// Reads `size` bytes at most; of the last group only the pixels that are asked for.
template <Word lanes_of(const std::uint8_t*), std::size_t bytes>
void unpack_groups(const std::uint8_t* in, std::size_t size, std::size_t pixels,
                   std::uint16_t* out) {
    const std::size_t whole = pixels / 4;
    for (std::size_t i = 0; i < whole; ++i) {
        const Word lanes = lanes_of(in + i * bytes);
        std::memcpy(out + i * 4, &lanes, sizeof lanes);
    }
    const std::size_t done = whole * 4;
    std::array<std::uint8_t, bytes> last{};
    std::copy(in + whole * bytes, in + size, last.begin());
    const Word lanes = lanes_of(last.data());
    std::memcpy(out + done, &lanes, (pixels - done) * sizeof *out);
}

void unpack_packed(const PixelFormat& format, const std::uint8_t* in, std::size_t size,
                   std::size_t pixels, std::uint16_t* out) {
    constexpr decltype(&unpack_groups<mipi_10, 5>) of_bits[][2] = {
        {unpack_groups<bit_stream_10, 5>, unpack_groups<bit_stream_12, 6>},
        {unpack_groups<gige_pairs_10, 6>, unpack_groups<gige_pairs_12, 6>},
        {unpack_groups<mipi_10, 5>, unpack_groups<mipi_12, 6>}};
    const auto row =
        static_cast<std::size_t>(format.packing) - static_cast<std::size_t>(bit_stream);
    of_bits[row][format.bits == 12](in, size, pixels, out);
}

// ---- lines -----------------------------------------------------------------------------------

void unpack_words(const PixelFormat& format, const std::uint8_t* in, std::size_t pixels,
                  std::uint16_t* out) {
    std::memcpy(out, in, 2 * pixels);
    if (format.big_endian)
        std::transform(out, out + pixels, out,
                       [](std::uint16_t w) { return static_cast<std::uint16_t>(w >> 8 | w << 8); });
    if (format.packing == words_high)
        std::transform(out, out + pixels, out, [&](std::uint16_t w) {
            return static_cast<std::uint16_t>(w >> (16 - format.bits));
        });
}

// `size` is line_bytes() of as many pixels.
void unpack_line(const PixelFormat& format, const std::uint8_t* in, std::size_t size,
                 std::size_t pixels, std::uint8_t* out) {
    const auto words = reinterpret_cast<std::uint16_t*>(out);
    switch (format.packing) {
        case bytes:
            std::memcpy(out, in, pixels);
            break;
        case words_low:
        case words_high:
            unpack_words(format, in, pixels, words);
            break;
        case luma_first:
        case luma_second:
            for (std::size_t i = 0; i < pixels; ++i)
                out[i] = in[2 * i + (format.packing == luma_second)];
            break;
        case bit_stream:
        case gige_pairs:
        case mipi_csi2:
            unpack_packed(format, in, size, pixels, words);
            break;
        case jpeg:
            break;
    }
}

std::size_t bytes_of(const PixelFormat& format, std::size_t pixels) {
    const std::size_t bits = static_cast<std::size_t>(format.bits);
    switch (format.packing) {
        case bytes:
            return pixels;
        case words_low:
        case words_high:
            return 2 * pixels;
        case bit_stream:
            return (pixels * bits + 7) / 8;
        case gige_pairs:
            return (pixels * 3 + 1) / 2;
        case mipi_csi2:
            return bits == 10 ? (pixels + 3) / 4 * 5 : (pixels + 1) / 2 * 3;
        case luma_first:
        case luma_second:
            return (pixels + 1) / 2 * 4;
        case jpeg:
            return 0;
    }
    return 0;
}

bool holds_bits(PixelPacking packing, int bits) {
    switch (packing) {
        case words_low:
        case words_high:
            return bits >= 9 && bits <= 16;
        case bit_stream:
        case gige_pairs:
        case mipi_csi2:
            return bits == 10 || bits == 12;
        default:
            return bits >= 1 && bits <= 8;
    }
}

// Whether the next line may begin in mid-byte.
bool lines_run_on(const PixelFormat& format, std::size_t bytes_per_line) {
    return bytes_per_line == 0 && (format.packing == bit_stream || format.packing == gige_pairs);
}

// What is wrong with an image's measures; empty if nothing.
std::string size_fault(const PixelFormat& format, const RawImage& raw) {
    if (raw.width <= 0 || raw.height <= 0)
        return fmt::format("an image of {}x{} pixels", raw.width, raw.height);
    if (!holds_bits(format.packing, format.bits))
        return fmt::format("{} bits do not fit the packing of {}", format.bits, format.name());
    const std::size_t line = line_bytes(format, raw.width);
    if (raw.bytes_per_line != 0 && raw.bytes_per_line < line)
        return fmt::format("{} bytes a line, {} pixels of {} need {}", raw.bytes_per_line,
                           raw.width, format.name(), line);
    const std::size_t needed = image_bytes(format, raw.width, raw.height, raw.bytes_per_line);
    if (raw.data.size() < needed)
        return fmt::format("{} bytes, {}x{} pixels of {} need {}", raw.data.size(), raw.width,
                           raw.height, format.name(), needed);
    return "";
}

// ---- JPEG ------------------------------------------------------------------------------------

// A JPEG is whole if it begins and ends with its markers; cameras pad behind with zeros.
bool is_whole_jpeg(std::span<const std::uint8_t> data) {
    while (!data.empty() && data.back() == 0)
        data = data.first(data.size() - 1);
    const std::size_t n = data.size();
    return n >= 5 && data[0] == 0xFF && data[1] == 0xD8 && data[2] == 0xFF && data[n - 2] == 0xFF &&
           data[n - 1] == 0xD9;
}

std::string unpack_jpeg(const RawImage& raw, CodeImage& image) {
    if (!is_whole_jpeg(raw.data))
        return fmt::format("{} bytes are no whole JPEG image", raw.data.size());
    cv::Mat decoded;
    try {
        decoded = decode_jpeg_luma(raw.data);
    } catch (const Error& error) {
        return std::string("the image ") + error.what();
    }
    if (decoded.cols != raw.width || decoded.rows != raw.height)
        return fmt::format("a JPEG image of {}x{}, expected {}x{}", decoded.cols, decoded.rows,
                           raw.width, raw.height);
    image = {decoded, 8};
    return "";
}

}  // namespace

std::span<const PixelFormat> pixel_formats() {
    return formats;
}

const PixelFormat* find_pfnc_format(std::string_view name) {
    return find(&PixelFormat::pfnc, name);
}

const PixelFormat* find_pfnc_format(std::uint32_t code) {
    return find(&PixelFormat::pfnc_code, code);
}

const PixelFormat* find_v4l2_format(std::string_view name) {
    return find(&PixelFormat::v4l2, name);
}

const PixelFormat* find_libcamera_format(std::string_view name) {
    return find(&PixelFormat::libcamera, name);
}

std::size_t line_bytes(const PixelFormat& format, int width) {
    return bytes_of(format, static_cast<std::size_t>(width));
}

std::size_t image_bytes(const PixelFormat& format, int width, int height,
                        std::size_t bytes_per_line) {
    const std::size_t lines = static_cast<std::size_t>(height);
    if (lines_run_on(format, bytes_per_line))
        return bytes_of(format, lines * static_cast<std::size_t>(width));
    const std::size_t line = line_bytes(format, width);
    return (lines - 1) * (bytes_per_line ? bytes_per_line : line) + line;
}

std::string unpack(const PixelFormat& format, const RawImage& raw, CodeImage& image) {
    std::string fault = size_fault(format, raw);
    if (fault.empty() && format.packing == jpeg)
        fault = unpack_jpeg(raw, image);
    if (!fault.empty())
        image = {};
    if (!fault.empty() || format.packing == jpeg)
        return fault;

    if (!image.pixels.isContinuous())
        image.pixels.release();
    image.pixels.create(raw.height, raw.width, format.bits <= 8 ? CV_8UC1 : CV_16UC1);
    image.bits = format.bits;
    if (lines_run_on(format, raw.bytes_per_line)) {
        unpack_line(format, raw.data.data(), image_bytes(format, raw.width, raw.height, 0),
                    image.pixels.total(), image.pixels.data);
        return "";
    }
    const std::size_t line = line_bytes(format, raw.width);
    const std::size_t distance = raw.bytes_per_line ? raw.bytes_per_line : line;
    for (int y = 0; y < raw.height; ++y)
        unpack_line(format, raw.data.data() + static_cast<std::size_t>(y) * distance, line,
                    static_cast<std::size_t>(raw.width), image.pixels.ptr(y));
    return "";
}

}  // namespace etalon
