// Pictures of which every byte is known: random, another one for each frame, with the frame's
// number and the start of its exposure written into the first pixels. So whoever receives one can
// say whether each byte is right, which frame it is, and how old it is.
#pragma once

#include <array>
#include <random>

#include "tests/vm/usb_camera.h"

namespace etalon {

struct PatternStamp {
    std::uint32_t frame = 0;
    Instant start;  // of the exposure, on this machine's clock

    static constexpr std::size_t pixels = 12;  // from the first one on, a byte in each
};

inline constexpr std::size_t noise_bytes = 1 << 17;

inline const std::vector<std::uint8_t>& noise() {
    static const std::vector<std::uint8_t> bytes = [] {
        std::vector<std::uint8_t> out(noise_bytes);
        std::mt19937 random(7);
        for (std::uint8_t& byte : out)
            byte = static_cast<std::uint8_t>(random());
        return out;
    }();
    return bytes;
}

// Each row is a piece of the noise from another place (Knuth's multiplicative hash).
inline std::size_t row_start(std::uint32_t frame, int row, std::size_t row_bytes) {
    const std::uint32_t hash = (frame * 4099u + static_cast<std::uint32_t>(row)) * 2654435761u;
    return (hash >> 8) % (noise_bytes - row_bytes);
}

inline std::array<std::uint8_t, PatternStamp::pixels> encoded(const PatternStamp& stamp) {
    const auto nanoseconds = static_cast<std::uint64_t>(stamp.start.time_since_epoch().count());
    std::array<std::uint8_t, PatternStamp::pixels> out{};
    for (std::size_t i = 0; i < 4; ++i)
        out[i] = static_cast<std::uint8_t>(stamp.frame >> (8 * i));
    for (std::size_t i = 0; i < 8; ++i)
        out[4 + i] = static_cast<std::uint8_t>(nanoseconds >> (8 * i));
    return out;
}

// The frame's bytes as they go over the wire: 16-bit pixels little-endian (y12: in the low bits),
// yuyv: luma at even bytes.
inline std::vector<std::uint8_t> pattern_frame(const StreamMode& mode, const PatternStamp& stamp) {
    const int pixel_bytes = bytes_per_pixel(mode.pixels);
    const auto row_bytes = static_cast<std::size_t>(mode.size.width * pixel_bytes);
    std::vector<std::uint8_t> frame(mode.frame_bytes());
    for (int y = 0; y < mode.size.height; ++y)
        std::copy_n(noise().begin() + static_cast<long>(row_start(stamp.frame, y, row_bytes)),
                    row_bytes, frame.begin() + static_cast<long>(row_bytes) * y);
    if (mode.pixels == UsbPixels::y12)
        for (std::size_t i = 1; i < frame.size(); i += 2)
            frame[i] &= 0x0F;
    const auto bytes = encoded(stamp);
    for (std::size_t i = 0; i < bytes.size(); ++i)
        frame[i * static_cast<std::size_t>(pixel_bytes)] = bytes[i];
    return frame;
}

// A source for UsbCamera.
inline std::vector<std::uint8_t> show_pattern(const UsbExposure& exposure) {
    return pattern_frame(exposure.mode, {exposure.frame, exposure.start});
}

// Of a frame's bytes. `pixel_bytes` is the distance from one grey value to the next.
inline PatternStamp read_stamp(std::span<const std::uint8_t> frame, int pixel_bytes) {
    const auto byte = [&](std::size_t i) -> std::uint64_t {
        return frame[i * static_cast<std::size_t>(pixel_bytes)];
    };
    std::uint64_t number = 0, nanoseconds = 0;
    for (std::size_t i = 0; i < 4; ++i)
        number |= byte(i) << (8 * i);
    for (std::size_t i = 0; i < 8; ++i)
        nanoseconds |= byte(4 + i) << (8 * i);
    return {static_cast<std::uint32_t>(number),
            Instant(Duration(static_cast<std::int64_t>(nanoseconds)))};
}

// Whether these are the bytes of the frame that its stamp says it is.
inline bool is_pattern(std::span<const std::uint8_t> frame, const StreamMode& mode) {
    if (frame.size() != mode.frame_bytes())
        return false;
    const auto expected = pattern_frame(mode, read_stamp(frame, bytes_per_pixel(mode.pixels)));
    return std::equal(frame.begin(), frame.end(), expected.begin());
}

}  // namespace etalon
