#include "capture/camera_recovery.h"

#include <fmt/format.h>

namespace etalon {
namespace {

using Log = std::function<void(const std::string&, const std::string&)>;

bool came_back(Camera& camera, Clock& clock, const std::stop_token& stop, const Log& log) {
    try {
        camera.reconnect(clock.now() + reconnect_time, stop);
        return true;
    } catch (const DeviceError& error) {
        log("camera not reconnected", error.what());
        return false;
    }
}

std::string waiting_text(const CameraBusy& busy, Duration longest) {
    const auto seconds = [](Duration time) { return std::chrono::duration<double>(time).count(); };
    return fmt::format(
        "{} is controlled by another program. A camera lets go of a program that was killed after "
        "its heartbeat time-out of {:.1f} s: waiting for that, up to {:.1f} s",
        busy.device(), seconds(busy.heartbeat_timeout()), seconds(longest));
}

}  // namespace

std::unique_ptr<Camera> open_when_free(const std::function<std::unique_ptr<Camera>()>& open,
                                       Clock& clock, const std::stop_token& stop,
                                       const std::function<void(const std::string&)>& tell) {
    constexpr std::chrono::milliseconds pause{500};
    std::optional<Instant> deadline;
    for (;;) {
        const Instant begun = clock.now();
        try {
            return open();
        } catch (const CameraBusy& busy) {
            if (deadline && begun >= *deadline)
                throw;
            const Duration longest = busy.heartbeat_timeout() + std::chrono::seconds(1);
            if (!deadline)
                tell(waiting_text(busy, longest));
            deadline = deadline.value_or(begun + longest);
        }
        if (!clock.wait_for(pause, stop))
            throw Interrupted();
    }
}

Frame frame_after_reconnecting(Camera& camera, Instant t, int retries, Clock& clock,
                               const std::stop_token& stop, const Log& log) {
    try {
        return camera.frame_after(t, retries, stop);
    } catch (const DeviceError& error) {
        log("camera lost", error.what());
        if (!came_back(camera, clock, stop, log))
            throw;
    }
    log("camera reconnected", "");
    return camera.frame_after(t, retries, stop);
}

}  // namespace etalon
