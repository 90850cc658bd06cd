// When a V4L2 frame's exposure began, as far as its stamp tells (v4l2_camera.h).
#pragma once

#include <fmt/format.h>

#include <deque>
#include <span>

#include "capture/frame/camera.h"

namespace etalon {

// What a driver's time stamp means.
enum class StampMeaning {
    nothing,         // of an unknown clock, or copied from elsewhere
    exposure_start,  // of the monotonic clock
    frame_end,       // of the monotonic clock, when the frame had arrived
};

// A buffer that the driver has done with, until it is given back.
struct FilledBuffer {
    unsigned index = 0;
    std::span<const std::uint8_t> data;  // the luma's or the only plane
    std::string fault;                 // the driver's flag, or an impossible answer; usually empty
    std::uint32_t sequence = 0;        // wraps
    std::chrono::nanoseconds stamp{};  // as given
    StampMeaning meaning = StampMeaning::nothing;
};

// How long before its stamp a USB camera's exposure may have begun: uvcvideo stamps a frame when
// its first data arrive. Assumed: at most four frames are on their way, one being exposed, so that
// an exposure began after the fourth frame before had arrived; and at most 100 ms ago for fast
// cameras, since the host may be late. A device that holds pictures longer cannot be told.
class UsbDelay {
public:
    static constexpr std::uint64_t frames_on_their_way = 4;
    static constexpr std::chrono::milliseconds host_delay{100};

    // What it will be for a camera that keeps to this period.
    static Duration expected(Duration period) {
        return std::max<Duration>(static_cast<int>(frames_on_their_way) * period, host_delay);
    }

    // Each frame in turn, with its number in the stream, which counts those that nobody received,
    // and its stamp. A stamp that does not advance begins again.
    void came(std::uint64_t number, std::chrono::nanoseconds stamp) {
        if (!latest_.empty() && stamp <= latest_.back().stamp)
            latest_.clear();
        latest_.push_back({number, stamp});
        if (latest_.size() > frames_on_their_way + 1)
            latest_.pop_front();
    }

    // From the newest frame's exposure to its stamp; nothing while no frame came so long before.
    std::optional<std::chrono::nanoseconds> longest() const {
        for (auto before = latest_.rbegin(); before != latest_.rend(); ++before)
            if (before->number + frames_on_their_way <= latest_.back().number)
                return std::max<std::chrono::nanoseconds>(latest_.back().stamp - before->stamp,
                                                          host_delay);
        return std::nullopt;
    }

private:
    struct Arrival {
        std::uint64_t number;
        std::chrono::nanoseconds stamp;
    };
    std::deque<Arrival> latest_;  // the newest at the back
};

// The moments between which an exposure began, and how that is known.
struct ExposureStart {
    Instant earliest, latest;
    TimeSource source = TimeSource::request;
};

class V4l2Timing {
public:
    struct Camera {
        Duration longest_hold{};  // from the end of an exposure to the stamp of its frame
        Duration shortest_exposure{}, longest_exposure{};  // equal where known
        bool over_usb = false;                             // stamped as UsbDelay says
    };
    // For a stream that starts now.
    V4l2Timing(const Camera& camera, Instant now) : camera_(camera), seen_empty_(now) {}

    // No frame was waiting at that moment.
    void saw_empty_queue(Instant now) { seen_empty_ = now; }

    // For each frame once, in their order, with its number in the stream: what is wrong with its
    // stamp; empty if nothing. A stamp ahead of the frame's arrival by up to the longest hold is
    // none, but is not used either.
    std::string check(const FilledBuffer& buffer, std::uint64_t number, Instant now) {
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

    // Of the frame that was checked last, taken from the queue at `now`. Where nothing is known of
    // the earliest start it is the beginning of time.
    ExposureStart exposure_start(const FilledBuffer& buffer, Instant now) const {
        ExposureStart start = stamped(buffer, now);
        if (!camera_.over_usb || buffer.meaning == StampMeaning::nothing)
            return start;
        const auto delay = usb_delay_.longest();
        const Instant earliest = delay ? instant_of(buffer.stamp - *delay) : Instant();
        const bool by_arrival = start.source == TimeSource::request;
        start.earliest = by_arrival ? std::min(start.earliest, earliest) : earliest;
        return start;
    }

    // Until a frame comes that surely began later than now.
    Duration longest_wait() const { return longest_delay() + camera_.longest_hold; }

private:
    // Of a stamp at the start of the exposure; of one before its frame's arrival, by rounding.
    static constexpr Duration stamp_accuracy = std::chrono::microseconds(500);
    static constexpr Duration stamp_lead = std::chrono::milliseconds(1);

    static double milliseconds_of(Duration duration) {
        return std::chrono::duration<double, std::milli>(duration).count();
    }

    // The kernel's monotonic clock is the one behind steady_clock.
    static Instant instant_of(std::chrono::nanoseconds stamp) {
        return Instant(std::chrono::duration_cast<Duration>(stamp));
    }

    // From the earliest start of an exposure to the stamp of its frame.
    Duration longest_delay() const { return camera_.longest_exposure + camera_.longest_hold; }
    ExposureStart stamped(const FilledBuffer& buffer, Instant now) const {
        const Instant stamp = instant_of(buffer.stamp);
        const Instant latest = stamp - camera_.shortest_exposure;
        switch (meaning_of(buffer, now)) {
            case StampMeaning::exposure_start:
                if (!camera_.over_usb)
                    return {stamp - stamp_accuracy, stamp + stamp_accuracy,
                            TimeSource::driver_start};
                return {stamp - longest_delay(), latest, TimeSource::driver_start};
            case StampMeaning::frame_end:
                return {stamp - longest_delay(), latest, TimeSource::driver_end};
            case StampMeaning::nothing:
                break;
        }
        return {seen_empty_ - longest_delay(), now - camera_.shortest_exposure,
                TimeSource::request};
    }
    StampMeaning meaning_of(const FilledBuffer& buffer, Instant now) const {
        // Some drivers stamp a frame's expected end and hand it out before.
        const bool ahead = instant_of(buffer.stamp) > now + stamp_lead;
        return ahead ? StampMeaning::nothing : buffer.meaning;
    }

    Camera camera_;
    Instant seen_empty_;
    std::optional<std::chrono::nanoseconds> last_stamp_;
    UsbDelay usb_delay_;
};

}  // namespace etalon
