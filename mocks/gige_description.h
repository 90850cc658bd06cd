// The mock GigE camera's own description of itself (GenICam, GenApi schema 1.0), written for
// Aravis' fake camera: what that one keeps at fixed registers (size, pixel format, exposure,
// trigger), with the names of SFNC 2, and what it lacks, at registers of the manufacturer's space.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace etalon {

// Registers that the fake camera itself knows nothing of. 4 bytes, big-endian.
inline constexpr std::uint32_t black_level_register = 0xA000;
inline constexpr std::uint32_t trigger_source_register = 0xA004;
inline constexpr std::uint32_t latch_register = 0xA010;         // 1: the clock shall be read
inline constexpr std::uint32_t latched_time_register = 0xA020;  // 8 bytes, ns

// `formats` are PFNC names that capture/pixel_formats.h knows. `latches`: whether the device's
// clock can be read.
std::string gige_description(const std::vector<std::string>& formats, bool latches);

}  // namespace etalon
