// A frame from a camera that may be gone for a while: a cable that was pulled, a power cycle.
#pragma once

#include <functional>

#include "capture/frame/camera.h"

namespace etalon {

// How long a lost camera is waited for.
inline constexpr std::chrono::seconds reconnect_time{20};

// camera.frame_after(), and once more after reconnecting a camera that failed. `log` is told
// "camera lost" and "camera reconnected" with the details. Throws what the camera throws: of a
// camera that does not come back, why it was lost.
Frame frame_after_reconnecting(
    Camera& camera, Instant t, int retries, Clock& clock, const std::stop_token& stop,
    const std::function<void(const std::string& event, const std::string& detail)>& log);

}  // namespace etalon
