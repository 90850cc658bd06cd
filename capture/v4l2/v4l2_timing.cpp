#include "capture/v4l2/v4l2_timing.h"

#include <fmt/format.h>

namespace etalon {
namespace {

using namespace std::chrono_literals;

constexpr Duration stamp_accuracy = 500us;  // of a stamp at the start of the exposure
constexpr Duration stamp_lead = 1ms;        // of a stamp before its frame's arrival, by rounding

double milliseconds_of(Duration duration) {
    return std::chrono::duration<double, std::milli>(duration).count();
}

// The kernel's monotonic clock is the one behind steady_clock.
Instant instant_of(std::chrono::nanoseconds stamp) {
    return Instant(std::chrono::duration_cast<Duration>(stamp));
}

}  // namespace

std::string V4l2Timing::check(const FilledBuffer& buffer, std::uint64_t number, Instant now) {
    if (buffer.meaning == StampMeaning::nothing)
        return "";
    const auto last = std::exchange(last_stamp_, buffer.stamp);
    usb_delay_.came(number, buffer.stamp);
    if (instant_of(buffer.stamp) > now + camera_.longest_hold + stamp_lead)
        return fmt::format("its time stamp lies {:.3f} ms in the future",
                           milliseconds_of(instant_of(buffer.stamp) - now));
    if (last && buffer.stamp <= *last)
        return fmt::format("its time stamp is {:.3f} ms before the last frame's",
                           milliseconds_of(*last - buffer.stamp));
    return "";
}

// Some drivers stamp a frame with the moment at which it would have ended, and hand it out before.
StampMeaning V4l2Timing::meaning_of(const FilledBuffer& buffer, Instant now) const {
    const bool ahead = instant_of(buffer.stamp) > now + stamp_lead;
    return ahead ? StampMeaning::nothing : buffer.meaning;
}

ExposureStart V4l2Timing::exposure_start(const FilledBuffer& buffer, Instant now) const {
    ExposureStart start = stamped(buffer, now);
    if (!camera_.over_usb || buffer.meaning == StampMeaning::nothing)
        return start;
    const auto delay = usb_delay_.longest();
    const Instant earliest = delay ? instant_of(buffer.stamp - *delay) : Instant();
    const bool by_arrival = start.source == TimeSource::request;
    start.earliest = by_arrival ? std::min(start.earliest, earliest) : earliest;
    return start;
}

ExposureStart V4l2Timing::stamped(const FilledBuffer& buffer, Instant now) const {
    const Instant stamp = instant_of(buffer.stamp);
    const Instant latest = stamp - camera_.shortest_exposure;
    switch (meaning_of(buffer, now)) {
        case StampMeaning::exposure_start:
            if (!camera_.over_usb)
                return {stamp - stamp_accuracy, stamp + stamp_accuracy, TimeSource::driver_start};
            return {stamp - longest_delay(), latest, TimeSource::driver_start};
        case StampMeaning::frame_end:
            return {stamp - longest_delay(), latest, TimeSource::driver_end};
        case StampMeaning::nothing:
            break;
    }
    return {seen_empty_ - longest_delay(), now - camera_.shortest_exposure, TimeSource::request};
}

}  // namespace etalon
