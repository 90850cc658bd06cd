// Pictures of which every byte is known: random, another one for each frame, with the frame's
// number and the start of its exposure written into the first pixels. So whoever receives one can
// say whether each byte is right, which frame it is, and how old it is.
#pragma once

#include "tests/vm/usb_camera.h"

namespace etalon {

struct PatternStamp {
    std::uint32_t frame = 0;
    Instant start;  // of the exposure, on this machine's clock

    static constexpr std::size_t pixels = 12;  // from the first one on, a byte in each
};

// The frame's bytes as they go over the wire: 16-bit pixels little-endian (y12: in the low bits),
// yuyv: luma at even bytes.
std::vector<std::uint8_t> pattern_frame(const StreamMode& mode, const PatternStamp& stamp);

// Of a frame's bytes. `pixel_bytes` is the distance from one grey value to the next.
PatternStamp read_stamp(std::span<const std::uint8_t> frame, int pixel_bytes);

// A source for UsbCamera.
inline std::vector<std::uint8_t> show_pattern(const UsbExposure& exposure) {
    return pattern_frame(exposure.mode, {exposure.frame, exposure.start});
}

// Whether these are the bytes of the frame that its stamp says it is.
bool is_pattern(std::span<const std::uint8_t> frame, const StreamMode& mode);

}  // namespace etalon
