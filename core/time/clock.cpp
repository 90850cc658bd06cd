#include "core/time/clock.h"

#include <algorithm>
#include <cmath>

namespace etalon {

Duration duration_of(double seconds) {
    constexpr double most_s = 1e9;
    const double within = std::isnan(seconds) ? 0.0 : std::clamp(seconds, -most_s, most_s);
    return std::chrono::duration_cast<Duration>(std::chrono::duration<double>(within));
}

Instant SteadyClock::now() const {
    return std::chrono::steady_clock::now();
}

bool SteadyClock::wait_until(Instant until, std::stop_token stop) {
    std::mutex mutex;
    std::condition_variable_any woken;
    std::unique_lock lock(mutex);
    woken.wait_until(lock, stop, until, [] { return false; });
    return now() >= until;
}

Instant VirtualClock::now() const {
    const std::scoped_lock lock(mutex_);
    return now_;
}

bool VirtualClock::wait_until(Instant until, std::stop_token stop) {
    if (stop.stop_requested())
        return false;
    const std::scoped_lock lock(mutex_);
    now_ = std::max(now_, until);
    return true;
}

void VirtualClock::advance(Duration duration) {
    const std::scoped_lock lock(mutex_);
    now_ += duration;
}

}  // namespace etalon
