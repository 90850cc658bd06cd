// A camera that takes pictures on request, whatever is behind it: a GenICam device, a folder of
// recorded images, or a mock. The contract that every backend keeps:
//
//   closed -- open (constructor) --> idle -- configure --> configured -- arm --> armed
//   armed -- frame_after --> armed          armed -- disarm --> configured
//
//   * A `complete` frame from frame_after(t) began its exposure after t, the uncertainty of the
//     clock mapping included. A backend that cannot know drains or restarts until it does.
//   * What was asked is what the camera does, or DeviceError says the difference.
//   * An incomplete frame comes back with its status; it is never handed on as good.
//   * disarm() and the destructor never throw and never hang (bounded by 3 s).
//
// One thread owns a camera; only the stop_token may be triggered from another.
#pragma once

#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "core/image.h"

namespace etalon {

struct CameraIdentity {
    std::string uri;                    // "genicam:127.0.0.1", "files:photos"
    std::string vendor, model, serial;  // empty where the device does not say
};

// Counters since opening, for the record.
struct CaptureStatistics {
    long delivered = 0;  // complete frames handed out
    long rejected = 0;   // too old, short, corrupt or lost, and triggered again
    long missing_packets = 0;
};

class Camera {
public:
    virtual ~Camera() = default;

    virtual const CameraIdentity& identity() const = 0;

    // Applies the settings, reads every one back, returns what is in force. Throws DeviceError when
    // the device refuses or changes one by more than its own step.
    virtual CaptureSettings configure(const CaptureSettings& wanted) = 0;

    virtual void arm() = 0;

    // Triggers and returns a frame whose exposure began after `t`. Bad frames are triggered again,
    // at most `retries` times, and counted; then the last one comes back with its status.
    // Throws DeviceError when the device is gone, Interrupted when a stop was requested.
    virtual Frame frame_after(Instant t, int retries, std::stop_token stop) = 0;

    virtual void disarm() noexcept = 0;

    virtual CaptureStatistics statistics() const = 0;

    // What limits this connection here, one line each, for the record and the operator ("the kernel
    // grants a receive buffer of 212992 bytes, 4194304 were asked ..."). Usually empty.
    virtual std::vector<std::string> remarks() const { return {}; }
};

// What `etalon devices` prints.
struct CameraBackend {
    std::string name;                     // "genicam", "files"
    bool built_in = false;                // false: its SDK was missing when this program was built
    std::string detail;                   // the SDK's version, or why it is left out
    std::vector<CameraIdentity> cameras;  // found now
};
std::vector<CameraBackend> list_cameras();

// Options of a connection that are no exposure settings.
struct CameraLink {
    int packet_size = 1400;                         // bytes, GigE Vision
    std::chrono::milliseconds frame_timeout{1000};  // from trigger to complete frame
};

// Opens by URI: `genicam:ID-or-IP`, `files:FOLDER`. Throws ConfigError for a URI that no backend
// knows and DeviceError when the device does not answer.
std::unique_ptr<Camera> open_camera(const std::string& uri, const CameraLink& link, Clock& clock);

}  // namespace etalon
