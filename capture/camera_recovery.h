// A camera that may be gone for a while: unplugged, power-cycled, or held by a killed program.
#pragma once

#include <functional>

#include "capture/frame/camera.h"

namespace etalon {

// How long a lost camera is waited for.
inline constexpr std::chrono::seconds reconnect_time{20};

// `open()`. A camera that another program controls is tried again until a dead program would have
// been noticed: for its heartbeat time-out and a second. `tell` is told once what is waited for and
// how long. Throws what `open` throws, CameraBusy in the end; Interrupted when a stop is requested.
std::unique_ptr<Camera> open_when_free(const std::function<std::unique_ptr<Camera>()>& open,
                                       Clock& clock, const std::stop_token& stop,
                                       const std::function<void(const std::string&)>& tell);

// camera.frame_after(), once more after reconnecting a camera that failed. `log` is told "camera
// lost" and "camera reconnected". Throws what the camera throws; without it coming back, the loss.
Frame frame_after_reconnecting(
    Camera& camera, Instant t, int retries, Clock& clock, const std::stop_token& stop,
    const std::function<void(const std::string& event, const std::string& detail)>& log);

}  // namespace etalon
