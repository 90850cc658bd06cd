// Warm-up and stability check: watches a static target with a camera until its image drifts by less
// than the limit, or the time is over. What `etalon capture --drift` does.
//
// What it cannot see: whether the camera or the target moves (both must stand on the same rigid
// base, and the target must not warm up); whether a growth is one of the focal length or of the
// distance; and what happens after it ended.
#pragma once

#include <functional>

#include "capture/frame/camera.h"
#include "compare/drift/drift_monitor.h"
#include "compare/drift/static_target.h"

namespace etalon {

struct DriftRequest {
    CaptureSettings settings;
    int retries = 5;
    Duration interval = std::chrono::seconds(1);  // between frames
    int frames = 3600;                            // at most
};

struct DriftResult {
    CameraIdentity camera;
    CaptureSettings settings;  // in force
    CaptureStatistics statistics;
    std::vector<std::string> remarks;
    DriftMonitor monitor;
    bool stable = false;
    Minutes duration{};
    std::string started_utc;
    std::string reason;  // why it ended before it was stable or all frames were taken; else empty
};

// Takes a frame per interval and hands what is known by then to `seen`. Ends when the drift is
// below the limit. A camera that fails ends it with a reason, after an attempt to reconnect; so
// does a stop request ("interrupted"). Throws DeviceError when the camera cannot be configured.
DriftResult watch_drift(Camera& camera, const TargetFinder& find_target,
                        const DriftRequest& request, Clock& clock, const std::stop_token& stop,
                        const std::function<void(const DriftMonitor&)>& seen);

}  // namespace etalon
