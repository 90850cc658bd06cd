// Reading a GenICam device's clock.
#pragma once

#include "capture/device_clock.h"
#include "capture/genicam_device.h"

namespace etalon {

// Latches the device's clock and reads what was latched: `at` is the clock's value in ns at some
// moment within the window. Nothing where the device has no clock that can be read, or does not
// latch within 50 ms. Throws DeviceError when the device does not answer. About 1 ms on a network.
struct GenicamClockReading {
    std::uint64_t device_ns = 0;
    TimeWindow window;
};
std::optional<GenicamClockReading> read_genicam_clock(const GenicamDevice& device,
                                                      const Clock& clock);

}  // namespace etalon
