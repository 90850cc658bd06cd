// What `etalon capture --drift` leaves behind.
//
//     drift.csv    one row per frame: time, movement of the target since its part's first frame
//     drift.json   `etalon: drift/1`: result, camera, every rate with its uncertainty, jumps
//     report.html  the same as plots, with what it cannot tell
#pragma once

#include "compare/drift/drift_monitor.h"
#include "station/devices/capture_run.h"

namespace etalon {

// Warm-up and stability check. It cannot tell whether the camera or the target moves: both must
// stand on one rigid base, and the target must not warm up. It cannot tell a change of focal length
// from one of distance, nor what happens later.

struct DriftRequest {
    CaptureSettings settings;
    int retries = 5;
    Duration interval = std::chrono::seconds(1);  // between frames
    int frames = 3600;                            // at most
};

struct DriftResult : CameraUse {
    DriftMonitor monitor;
    bool stable = false;
    Minutes duration{};
};

// Takes a frame per interval and hands what is known to `seen`. Ends when the drift is below the
// limit, or with a reason. Throws DeviceError for a camera that cannot be configured.
DriftResult watch_drift(Camera& camera, const TargetFinder& find_target,
                        const DriftRequest& request, Clock& clock, const std::stop_token& stop,
                        const std::function<void(const DriftMonitor&)>& seen);

// "drift 0.013 px/min stable after 12.4 min", and what stands there of a camera that is not.
std::string drift_sentence(const DriftResult& result);

// For a terminal: at most 79 columns.
std::string drift_line(const DriftMonitor& monitor);

}  // namespace etalon
