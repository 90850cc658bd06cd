// The mock GigE camera's description of itself (GenICam, GenApi schema 1.0, names of SFNC 2), for
// Aravis' fake camera with its fixed registers and some in the manufacturer's space.
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

inline constexpr std::uint32_t chunk_mode_register = 0xA030;
inline constexpr std::uint32_t chunk_selector_register = 0xA034;
inline constexpr std::uint32_t chunk_enable_registers =
    0xA040;  // one for each choice of the selector
inline constexpr std::uint32_t ptp_enable_register = 0xA080;
inline constexpr std::uint32_t ptp_latch_register = 0xA084;
inline constexpr std::uint32_t ptp_status_register = 0xA088;
inline constexpr std::uint32_t ptp_offset_register = 0xA090;  // 8 bytes, ns, signed

// The chunks of a frame. `selected` is the number in the selector, whose 0 is the image.
struct MockChunk {
    const char* name;
    std::uint32_t selected;
    std::uint32_t id;
    std::size_t bytes;
};
inline constexpr std::uint32_t image_chunk_id = 0x1;
inline constexpr MockChunk exposure_chunk{"ExposureTime", 1, 0x1001,
                                          8};                           // us, little-endian double
inline constexpr MockChunk gain_chunk{"Gain", 2, 0x1002, 4};            // dB/10, little-endian
inline constexpr MockChunk timestamp_chunk{"Timestamp", 3, 0x1003, 8};  // ns, big-endian
inline constexpr MockChunk frame_id_chunk{"FrameID", 4, 0x1004, 8};     // big-endian
inline constexpr MockChunk mock_chunks[] = {exposure_chunk, gain_chunk, timestamp_chunk,
                                            frame_id_chunk};

// States of PTP, by their numbers in IEEE 1588.
struct PtpStatusCode {
    const char* name;
    std::uint32_t value;
};
inline constexpr PtpStatusCode ptp_status_codes[] = {
    {"Disabled", 3}, {"Listening", 4}, {"Master", 6}, {"Uncalibrated", 8}, {"Slave", 9}};

struct GigeFeatures {
    std::vector<std::string> formats;  // PFNC names that capture/frame/pixel_formats.h knows
    bool latches = false;              // whether the device's clock can be read
    bool chunks = false;
    bool ptp = false;
};
std::string gige_description(const GigeFeatures& features);

}  // namespace etalon
