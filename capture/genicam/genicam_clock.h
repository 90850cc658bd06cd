// Reading a GenICam device's clock, and whether PTP governs it.
#pragma once

#include "capture/frame/camera.h"
#include "capture/genicam/genicam_device.h"

namespace etalon {

// Latches the device's clock and reads what was latched: the clock's value at some moment within
// the window. Nothing where the device has no clock that can be read, or does not latch within 50
// ms. Throws DeviceError when the device does not answer. About 1 ms on a network.
struct GenicamClockReading {
    std::uint64_t device_ns = 0;
    TimeWindow window;
};
std::optional<GenicamClockReading> read_genicam_clock(const GenicamDevice& device,
                                                      const Clock& clock);

// The part that a device's clock has in the Precision Time Protocol (IEEE 1588). While it is
// neither synchronised nor the master, the protocol may set it at any moment, and a reading is
// worth nothing at the next.
struct PtpState {
    std::string status;                     // in the device's words: "Listening", "Slave"
    std::optional<std::int64_t> offset_ns;  // of a slave from its master, by its own estimate

    bool steady() const { return status == "Slave" || status == "Master"; }
};

// Nothing where the device has no PTP or it is switched off; it is never switched here. Throws
// DeviceError when the device does not answer. About 1 ms on a network where it is on.
std::optional<PtpState> read_ptp(const GenicamDevice& device);

// Of the counter that GigE Vision devices stamp frames with; 0 for others, which count ns.
std::uint64_t genicam_tick_frequency(const GenicamDevice& device);
std::uint64_t nanoseconds_of_ticks(std::uint64_t ticks, std::uint64_t frequency);

}  // namespace etalon
