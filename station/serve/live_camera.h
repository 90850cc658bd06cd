// The camera's picture while a station is set up: ten small frames a second, with the marker's
// outline. It lets the camera go when nobody has looked for a while.
#pragma once

#include <atomic>
#include <thread>

#include "station/devices/live_view.h"
#include "station/setup/station_file.h"

namespace etalon {

// The newest of changing values: a slow reader misses what lay between and delays no other.
template <class Value>
class LatestValue {
public:
    struct Seen {
        long number = 0;  // counts the values, from 1
        std::shared_ptr<const Value> value;
    };

    void put(Value value) {
        auto shared = std::make_shared<const Value>(std::move(value));
        {
            const std::lock_guard lock(mutex_);
            newest_ = {newest_.number + 1, std::move(shared)};
        }
        changed_.notify_all();
    }

    // The first value after number `seen` or a later one, waited for so long.
    std::optional<Seen> after(long seen, std::chrono::milliseconds at_most) const {
        std::unique_lock lock(mutex_);
        if (!changed_.wait_for(lock, at_most, [&] { return newest_.number > seen; }))
            return std::nullopt;
        return newest_;
    }

private:
    mutable std::mutex mutex_;
    mutable std::condition_variable changed_;
    Seen newest_;
};

struct LivePicture {
    std::string jpeg;  // empty where the frame was broken
    LiveFigures figures;
    double exposure_us = 0.0, gain_db = 0.0;  // in force
    bool marker_seen = false;
    std::string marker_detail;  // why not
    std::string fault;          // of the camera: the last picture
};

class LiveCamera {
public:
    // Opens the camera on its thread; what fails is the last picture's `fault`. Costs some 10 ms
    // of CPU time per frame of a megapixel, and a detection each second.
    explicit LiveCamera(const StationFile& station);
    ~LiveCamera() { release(); }
    LiveCamera(const LiveCamera&) = delete;
    LiveCamera& operator=(const LiveCamera&) = delete;

    // From the next frame on; 0 exposure leaves it.
    void set(double exposure_us, double gain_db);

    const LatestValue<LivePicture>& pictures() const { return pictures_; }
    bool has_ended() const { return ended_; }

    // A reader tells that it is there: without one for ten seconds the camera is released.
    void look();

    // Returns when the camera is released, 3 s later at most; readers may keep the object.
    void release();

private:
    struct Adjustment {
        double exposure_us, gain_db;
    };
    void watch(const std::stop_token& stop);
    void take_pictures(Camera& camera, CaptureSettings settings, Clock& clock,
                       const std::stop_token& stop);

    StationFile station_;
    LatestValue<LivePicture> pictures_;
    std::atomic<Instant> looked_at_;
    std::atomic<bool> ended_ = false;
    std::mutex mutex_, release_mutex_;
    std::optional<Adjustment> adjustment_;
    std::jthread thread_;
};

}  // namespace etalon
