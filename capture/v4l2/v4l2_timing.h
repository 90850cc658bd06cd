// When the exposure of a V4L2 frame began, as far as its time stamp tells. What each kind of stamp
// proves is in v4l2_camera.h.
#pragma once

#include <optional>
#include <string>

#include "capture/v4l2/usb_delay.h"
#include "capture/v4l2/v4l2_stream.h"

namespace etalon {

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
        bool over_usb = false;                             // stamped as in usb_delay.h
    };
    // For a stream that starts now.
    V4l2Timing(const Camera& camera, Instant now) : camera_(camera), seen_empty_(now) {}

    // No frame was waiting at that moment.
    void saw_empty_queue(Instant now) { seen_empty_ = now; }

    // For each frame once, in their order, with its number in the stream: what is wrong with its
    // stamp; empty if nothing. A stamp ahead of the frame's arrival by up to the longest hold is
    // none, but is not used either.
    std::string check(const FilledBuffer& buffer, std::uint64_t number, Instant now);

    // Of the frame that was checked last, taken from the queue at `now`. Where nothing is known of
    // the earliest start it is the beginning of time.
    ExposureStart exposure_start(const FilledBuffer& buffer, Instant now) const;

    // Until a frame comes that surely began later than now: it is stamped so much later, and is the
    // next after that.
    Duration longest_wait() const { return longest_delay() + camera_.longest_hold; }

private:
    // From the earliest start of an exposure to the stamp of its frame.
    Duration longest_delay() const { return camera_.longest_exposure + camera_.longest_hold; }
    ExposureStart stamped(const FilledBuffer& buffer, Instant now) const;
    StampMeaning meaning_of(const FilledBuffer& buffer, Instant now) const;

    Camera camera_;
    Instant seen_empty_;
    std::optional<std::chrono::nanoseconds> last_stamp_;
    UsbDelay usb_delay_;
};

}  // namespace etalon
