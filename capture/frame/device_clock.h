// A device's clock mapped to the station's: what a stamp of the device means, from a reading of its
// clock that is known to lie between two instants. Rates may differ by 200 ppm, more than any
// quartz does, and the uncertainty grows by that with the distance from the reading.
//
// Epochs do not matter, so a clock that PTP disciplines is treated like any other: TAI and UTC
// cannot be confused.
#pragma once

#include <cstdint>
#include <optional>

#include "core/time/clock.h"

namespace etalon {

// A moment within [earliest, latest].
struct TimeWindow {
    Instant earliest{}, latest{};

    bool empty() const { return earliest > latest; }
    Instant middle() const { return earliest + (latest - earliest) / 2; }
    Duration half_width() const { return (latest - earliest) / 2; }
};
TimeWindow intersection(const TimeWindow& a, const TimeWindow& b);

class DeviceClock {
public:
    // The device's clock showed `device_ns` at some moment within the window.
    void read(std::uint64_t device_ns, const TimeWindow& window);
    void forget() { reading_.reset(); }
    bool known() const { return reading_.has_value(); }

    // Throws std::bad_optional_access where nothing was read.
    TimeWindow station_time(std::uint64_t device_ns) const;

private:
    struct Reading {
        std::uint64_t device_ns;
        TimeWindow window;
    };
    std::optional<Reading> reading_;
};

}  // namespace etalon
