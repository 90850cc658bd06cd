// How long before its time stamp the exposure of a USB camera's frame may have begun. The kernel's
// driver (uvcvideo) stamps a frame when its first data arrive, and camera and host have held it
// back before. Taken for granted is that at most four frames are on their way, one being exposed
// and three held, so that an exposure began after the fourth frame before had arrived, however slow
// the camera really is; and of fast cameras, that it began at most 100 ms ago, since the host may
// be late by many of their frames. A device that holds pictures longer cannot be told.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <deque>
#include <optional>

#include "core/time/clock.h"

namespace etalon {

class UsbDelay {
public:
    static constexpr std::uint64_t frames_on_their_way = 4;
    static constexpr std::chrono::milliseconds host_delay{100};

    // What it will be for a camera that keeps to this period.
    static Duration expected(Duration period) {
        return std::max<Duration>(static_cast<int>(frames_on_their_way) * period, host_delay);
    }

    // Each frame in turn, with its number in the stream, which counts those that nobody received,
    // and its stamp. A stamp that does not advance begins anew.
    void came(std::uint64_t number, std::chrono::nanoseconds stamp) {
        if (!latest_.empty() && stamp <= latest_.back().stamp)
            latest_.clear();
        latest_.push_back({number, stamp});
        if (latest_.size() > frames_on_their_way + 1)
            latest_.pop_front();
    }

    // From the beginning of the newest frame's exposure to its stamp; nothing while it is not
    // known of any frame that it came so long before.
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

}  // namespace etalon
