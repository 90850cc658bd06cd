// A camera that takes pictures on request: GenICam, V4L2, libcamera, a folder of images, a mock.
// The contract of every backend (tests/capture/frame/camera_contract.h checks each):
//
//   closed -- open (constructor) --> idle -- configure --> configured -- arm --> armed
//   armed -- frame_after --> armed          armed -- disarm --> configured
//   any -- the device is gone: DeviceError --> lost -- reconnect --> as it was before
//
//   * A `complete` frame from frame_after(t) began its exposure after t, clock uncertainty
//     included. A backend that cannot know drains or restarts until it does.
//   * Every setting is read back; DeviceError says a difference. A configure() that threw leaves
//     the camera idle.
//   * An incomplete frame comes back with its status and without an image. Codes are in the low
//     bits of a pixel, 9 to 16 bits in 16, none lost.
//   * Automatic and enhancing functions are off; remarks() names those that cannot be.
//   * disarm() and the destructor never throw and never hang (3 s), lost or not.
//
// One thread owns a camera; only the stop_token may be triggered from another.
#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "core/image/image.h"
#include "core/program/errors.h"

namespace etalon {

struct CameraIdentity {
    std::string uri;                    // "genicam:127.0.0.1", "v4l2:/dev/video0", "files:photos"
    std::string vendor, model, serial;  // empty where the device does not say
};

// Counters since opening, for the record.
struct CaptureStatistics {
    long delivered = 0;  // complete frames handed out
    long rejected = 0;   // too old, short, corrupt or lost, and triggered again
    long missing_packets = 0;
    long resent_packets = 0;  // that came after they were asked for again
    long underruns = 0;       // frames that found no buffer to be written to
    long skipped = 0;         // that the device's frame counter counted and nobody received
    long reconnects = 0;
};

// What a device can do. Image sizes from `smallest` to `largest` in steps; equal: a single size.
struct FrameSizes {
    cv::Size smallest, largest;
    cv::Size step{1, 1};
};

struct CameraFormat {
    std::string name;         // what CaptureSettings::format takes
    std::string description;  // the device's own words; may be empty
    int bits = 0;             // of a pixel as delivered; 0: this program cannot unpack the format
    std::vector<FrameSizes> sizes;
};

struct CameraControl {
    std::string name;   // the device's own
    std::string value;  // now: a number, or the chosen one of `choices`
    std::string unit;   // empty where the device does not say
    // Of numbers; nothing where the device does not say.
    std::optional<double> low, high, step;
    std::vector<std::string> choices;  // of a menu
    bool read_only = false;
};

struct CameraAbilities {
    std::vector<CameraFormat> formats;
    std::vector<CameraControl> controls;
};

class Camera {
public:
    virtual ~Camera() = default;

    virtual const CameraIdentity& identity() const = 0;

    // Asks an idle or configured camera; empty for what is no device. Throws DeviceError when it is
    // gone.
    virtual CameraAbilities abilities() const { return {}; }

    // Applies the settings, reads every one back, returns what is in force. Throws DeviceError when
    // the device refuses or changes one by more than its own step.
    virtual CaptureSettings configure(const CaptureSettings& wanted) = 0;

    virtual void arm() = 0;

    // Triggers and returns a frame whose exposure began after `t`. Bad frames are triggered again,
    // at most `retries` times, and counted; then the last one that came comes back with its status.
    // Throws DeviceError when the device is gone, Interrupted when a stop was requested.
    virtual Frame frame_after(Instant t, int retries, std::stop_token stop) = 0;

    virtual void disarm() noexcept = 0;

    // Waits for a lost device until `deadline`, opens it, requires the same serial number, applies
    // and compares the settings, and arms if it was armed. May be tried again. Throws DeviceError
    // when it does not come back as it was, or cannot; Interrupted when a stop was requested.
    virtual void reconnect(Instant deadline, std::stop_token stop) = 0;

    virtual CaptureStatistics statistics() const = 0;

    // What limits this connection or cannot be switched off, one line each, for the record and the
    // operator ("sharpness stays at 3: it cannot be switched off"). Usually empty.
    virtual std::vector<std::string> remarks() const { return {}; }
};

struct CameraBackend {
    std::string name;                     // "genicam", "files"
    bool built_in = false;                // false: its SDK was missing when this program was built
    std::string detail;                   // the SDK's version, or why it is left out
    std::vector<CameraIdentity> cameras;  // found
};

// What this program can open, without a question to any device.
std::vector<CameraBackend> camera_backends();

// The same with the cameras that answer now (`etalon devices`); asks the networks, about a second.
std::vector<CameraBackend> list_cameras();

// Options of a connection that are no exposure settings.
struct CameraLink {
    std::chrono::milliseconds frame_timeout{1000};  // from trigger to complete frame
    // GigE Vision only.
    int packet_size = 1400;                     // bytes
    std::chrono::microseconds packet_delay{0};  // between two packets; 0 leaves the device's own
    std::string
        interface;  // IP address of the network card to use; empty: the library looks for it
};

// The table of a plugin with a camera backend (core/program/plugin.h).
struct CameraPlugin {
    std::vector<CameraIdentity> (*list)();
    // `id` is what follows the colon of the URI.
    std::unique_ptr<Camera> (*open)(const std::string& id, const CameraLink& link, Clock& clock);
};

// Opens by URI: `genicam:ID-or-IP`, `v4l2:/dev/video0`, `libcamera:ID`, `files:FOLDER`. Throws
// ConfigError for a URI that no backend knows and DeviceError when the device does not answer.
std::unique_ptr<Camera> open_camera(const std::string& uri, const CameraLink& link, Clock& clock);

// Another program controls the camera, or a killed one still seems to, until its heartbeat has been
// missing for this long.
class CameraBusy : public DeviceError {
public:
    CameraBusy(const std::string& device, std::chrono::milliseconds heartbeat_timeout)
        : DeviceError(device, "open", "it is controlled by another program"),
          heartbeat_timeout_(heartbeat_timeout) {}

    std::chrono::milliseconds heartbeat_timeout() const { return heartbeat_timeout_; }

private:
    std::chrono::milliseconds heartbeat_timeout_;
};

// A device's clock mapped to the station's, from a reading known to lie between two instants. Rates
// may differ by 200 ppm, more than any quartz: the uncertainty grows by that with the distance from
// the reading. Epochs do not matter: TAI and UTC cannot be confused.

// A moment within [earliest, latest].
struct TimeWindow {
    Instant earliest{}, latest{};

    bool empty() const { return earliest > latest; }
    Instant middle() const { return earliest + (latest - earliest) / 2; }
    Duration half_width() const { return (latest - earliest) / 2; }
};
inline TimeWindow intersection(const TimeWindow& a, const TimeWindow& b) {
    return {std::max(a.earliest, b.earliest), std::min(a.latest, b.latest)};
}

class DeviceClock {
public:
    // The device's clock showed `device_ns` at some moment within the window.
    void read(std::uint64_t device_ns, const TimeWindow& window) {
        reading_.emplace(device_ns, window);
    }
    void forget() { reading_.reset(); }
    bool known() const { return reading_.has_value(); }

    // Throws std::bad_optional_access where nothing was read.
    TimeWindow station_time(std::uint64_t device_ns) const {
        const auto& [read_ns, window] = reading_.value();
        // The difference of two unsigned counters is right across a wrap of 64 bits.
        const auto since = std::chrono::nanoseconds(static_cast<std::int64_t>(device_ns - read_ns));
        const Duration drift = std::chrono::abs(since) / rate_parts;
        return {window.earliest + since - drift, window.latest + since + drift};
    }

private:
    static constexpr std::int64_t rate_parts = 5000;  // 1 / 5000 = 200 ppm

    std::optional<std::pair<std::uint64_t, TimeWindow>> reading_;
};

}  // namespace etalon
