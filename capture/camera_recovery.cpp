#include "capture/camera_recovery.h"

#include "core/errors.h"

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

}  // namespace

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
