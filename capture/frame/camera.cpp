#include "capture/frame/camera.h"

#include <algorithm>

namespace etalon {
namespace {

constexpr std::int64_t rate_parts = 5000;  // 1 / 5000 = 200 ppm

}  // namespace

TimeWindow intersection(const TimeWindow& a, const TimeWindow& b) {
    return {std::max(a.earliest, b.earliest), std::min(a.latest, b.latest)};
}

void DeviceClock::read(std::uint64_t device_ns, const TimeWindow& window) {
    reading_ = {device_ns, window};
}

TimeWindow DeviceClock::station_time(std::uint64_t device_ns) const {
    const Reading& reading = reading_.value();
    // The difference of two unsigned counters is right across a wrap of 64 bits.
    const auto since =
        std::chrono::nanoseconds(static_cast<std::int64_t>(device_ns - reading.device_ns));
    const Duration drift = std::chrono::abs(since) / rate_parts;
    return {reading.window.earliest + since - drift, reading.window.latest + since + drift};
}

}  // namespace etalon
