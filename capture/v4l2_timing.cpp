#include "capture/v4l2_timing.h"

#include <fmt/format.h>

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr Duration stamp_accuracy = 500us;  // of a stamp at the start of the exposure
constexpr Duration stamp_lead = 1ms;        // a stamp further in the future is wrong

double milliseconds_of(Duration duration) {
    return std::chrono::duration<double, std::milli>(duration).count();
}

// The kernel's monotonic clock is the one behind steady_clock.
Instant instant_of(std::chrono::nanoseconds stamp) {
    return Instant(std::chrono::duration_cast<Duration>(stamp));
}

}  // namespace

std::string V4l2Timing::check(const FilledBuffer& buffer, Instant now) {
    if (buffer.meaning == StampMeaning::nothing)
        return "";
    const auto last = last_stamp_;
    last_stamp_ = buffer.stamp;
    if (instant_of(buffer.stamp) > now + stamp_lead)
        return fmt::format("its time stamp lies {:.3f} ms in the future",
                           milliseconds_of(instant_of(buffer.stamp) - now));
    if (last && buffer.stamp <= *last)
        return fmt::format("its time stamp is {:.3f} ms before the last frame's",
                           milliseconds_of(*last - buffer.stamp));
    return "";
}

ExposureStart V4l2Timing::exposure_start(const FilledBuffer& buffer, Instant now) const {
    const Instant stamp = instant_of(buffer.stamp);
    if (buffer.meaning == StampMeaning::exposure_start && !camera_.stamps_first_data)
        return {stamp - stamp_accuracy, stamp + stamp_accuracy};
    const bool known = buffer.meaning != StampMeaning::nothing;
    const Instant earliest_end = known ? stamp : seen_empty_, latest_end = known ? stamp : now;
    return {earliest_end - longest_delay(), latest_end - camera_.shortest_exposure};
}

TimeSource V4l2Timing::source(const FilledBuffer& buffer) const {
    switch (buffer.meaning) {
        case StampMeaning::exposure_start:
            return TimeSource::driver_start;
        case StampMeaning::frame_end:
            return TimeSource::driver_end;
        case StampMeaning::nothing:
            return TimeSource::request;
    }
    return TimeSource::request;
}

}  // namespace etalon
