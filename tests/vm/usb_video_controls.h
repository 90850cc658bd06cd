// The adjustable values of the USB camera (UVC 1.1, 4.2): exposure, gain, and what a measuring
// client has to switch off. They start as a consumer's camera has them: everything automatic and
// sharpened. Whoever wants to set the exposure has to end the automatic first, as with real ones.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace etalon {

class UsbVideoControls {
public:
    explicit UsbVideoControls(int sharpness);

    // The answer to GET_xxx `request` of the selector of an entity; nothing: unknown, refused.
    std::optional<std::vector<std::uint8_t>> get(int entity, int selector, int request) const;

    // SET_CUR; false: unknown, out of range or refused.
    bool set(int entity, int selector, std::span<const std::uint8_t> value);

    std::chrono::microseconds exposure() const;
    bool automatic_exposure() const;
    double gain_db() const;
    int sharpness() const;  // 0 is neutral

private:
    std::vector<std::int32_t> values_;  // in the order of the table
};

// The entity's bits of supported controls, as its descriptor has them.
std::uint32_t control_bits(int entity);

}  // namespace etalon
