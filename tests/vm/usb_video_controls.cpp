#include "tests/vm/usb_video_controls.h"

#include <array>
#include <cstddef>

#include "tests/vm/usb_video_descriptors.h"

namespace etalon {
namespace {

// Requests (UVC 1.1, table A-8).
constexpr int get_current = 0x81, get_minimum = 0x82, get_maximum = 0x83, get_step = 0x84,
              get_length = 0x85, get_info = 0x86, get_default = 0x87;
constexpr std::uint8_t can_get = 1, can_set = 2, disabled_by_automatic = 4;
constexpr std::int32_t manual = 1, aperture_priority = 8;  // of the exposure mode, a bit each

struct Control {
    int entity, selector;
    int bit;   // in the entity's descriptor
    int size;  // bytes
    std::int32_t minimum, maximum, step, initial;
};

enum Index : std::size_t {  // of the table
    mode_index,
    exposure_index,
    gain_index,
    sharpness_index
};

// Exposure in 100 us, gain in 0.1 dB. The mode's "step" is the set of its possible values.
constexpr std::array<Control, 8> table{{
    {camera_terminal, 0x02, 1, 1, manual, aperture_priority, manual | aperture_priority,
     aperture_priority},                             // exposure mode
    {camera_terminal, 0x04, 3, 4, 1, 5000, 1, 157},  // exposure time
    {processing_unit, 0x04, 9, 2, 0, 240, 1, 30},    // gain
    {processing_unit, 0x08, 4, 2, 0, 7, 1, 3},       // sharpness
    {processing_unit, 0x03, 1, 2, 0, 100, 1, 50},    // contrast
    {processing_unit, 0x02, 0, 2, -64, 64, 1, 0},    // brightness
    {processing_unit, 0x05, 10, 1, 0, 2, 1, 1},      // against lamps' flicker: 0 is off
    {processing_unit, 0x01, 8, 2, 0, 2, 1, 1},       // backlight compensation: 0 is off
}};

std::optional<std::size_t> find(int entity, int selector) {
    for (std::size_t i = 0; i < table.size(); ++i)
        if (table[i].entity == entity && table[i].selector == selector)
            return i;
    return std::nullopt;
}

std::vector<std::uint8_t> encoded(std::int32_t value, int size) {
    std::vector<std::uint8_t> out;
    put(out, size, static_cast<std::uint32_t>(value));
    return out;
}

std::int32_t decoded(std::span<const std::uint8_t> bytes, bool with_sign) {
    std::uint32_t value = 0;
    for (std::size_t i = 0; i < bytes.size(); ++i)
        value |= static_cast<std::uint32_t>(bytes[i]) << (8 * i);
    if (with_sign && bytes.size() == 2)
        return static_cast<std::int16_t>(value);
    return static_cast<std::int32_t>(value);
}

}  // namespace

UsbVideoControls::UsbVideoControls(int sharpness) {
    for (const Control& control : table)
        values_.push_back(control.initial);
    values_[sharpness_index] = sharpness;
}

std::optional<std::vector<std::uint8_t>> UsbVideoControls::get(int entity, int selector,
                                                               int request) const {
    const auto index = find(entity, selector);
    if (!index)
        return std::nullopt;
    const Control& control = table[*index];
    const bool disabled = *index == exposure_index && automatic_exposure();
    switch (request) {
        case get_current:
            return encoded(values_[*index], control.size);
        case get_minimum:
            return encoded(control.minimum, control.size);
        case get_maximum:
            return encoded(control.maximum, control.size);
        case get_step:
            return encoded(control.step, control.size);
        case get_default:
            return encoded(control.initial, control.size);
        case get_length:
            return encoded(control.size, 2);
        case get_info:
            return encoded(can_get | can_set | (disabled ? disabled_by_automatic : 0), 1);
        default:
            return std::nullopt;
    }
}

bool UsbVideoControls::set(int entity, int selector, std::span<const std::uint8_t> bytes) {
    const auto index = find(entity, selector);
    if (!index || bytes.size() != static_cast<std::size_t>(table[*index].size))
        return false;
    const Control& control = table[*index];
    const std::int32_t value = decoded(bytes, control.minimum < 0);
    if (value < control.minimum || value > control.maximum)
        return false;
    if (*index == mode_index && value != manual && value != aperture_priority)
        return false;
    if (*index == exposure_index && automatic_exposure())
        return false;
    values_[*index] = value;
    return true;
}

std::chrono::microseconds UsbVideoControls::exposure() const {
    return std::chrono::microseconds(100 * values_[exposure_index]);
}
bool UsbVideoControls::automatic_exposure() const {
    return values_[mode_index] != manual;
}
double UsbVideoControls::gain_db() const {
    return 0.1 * values_[gain_index];
}
int UsbVideoControls::sharpness() const {
    return values_[sharpness_index];
}

std::uint32_t control_bits(int entity) {
    std::uint32_t bits = 0;
    for (const Control& control : table)
        if (control.entity == entity)
            bits |= 1u << control.bit;
    return bits;
}

}  // namespace etalon
