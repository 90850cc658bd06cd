// One libcamera camera, reduced to what the backend needs of it and said in plain types, so that
// tests can script one. It neither judges frames nor knows what was wished for.
//
// Only what libcamera 0.0.3 and all later versions have is used; controls and pixel formats go by
// their names, so that one which a version lacks is one that this camera lacks.
#pragma once

#include "capture/frame/frame_checks.h"
#include "capture/v4l2/v4l2_timing.h"

namespace etalon {

// Controls or metadata by libcamera's names; booleans are 0 and 1, choices their number. Only
// scalar ones.
using LibcameraValues = std::map<std::string, double>;

struct LibcameraRange {
    double low = 0.0, high = 0.0, standard = 0.0;
};

struct LibcameraFormat {
    std::string name;  // "R8", "SRGGB10_CSI2P"
    std::vector<FrameSizes> sizes;
};

// What a stream of images is configured to.
struct LibcameraStream {
    std::string format;
    cv::Size size;
    std::size_t bytes_per_line = 0;
    bool limited_range = false;  // of YUV formats: codes from 16 to 235 only
};

// A request that came back.
struct LibcameraFrame {
    enum class Status { complete, error, cancelled };

    int buffer = 0;  // to be given back
    Status status = Status::complete;
    std::uint64_t sequence = 0;                // counts the device's frames since start()
    std::optional<std::int64_t> timestamp_ns;  // SensorTimestamp
    LibcameraValues metadata;
    std::span<const std::uint8_t> data;  // of the first plane; valid until given back
};

// The clocks that a SensorTimestamp may refer to, read together. `boot_ns` counts on while the
// machine is suspended, `monotonic_ns` does not.
struct KernelTime {
    std::int64_t monotonic_ns = 0, boot_ns = 0;
};

// One thread owns it. All throw DeviceError with libcamera's reason, except as said.
class LibcameraDevice {
public:
    virtual ~LibcameraDevice() = default;

    virtual const CameraIdentity& identity() const = 0;
    virtual std::vector<LibcameraFormat> formats() const = 0;
    virtual std::map<std::string, LibcameraRange> controls() const = 0;

    // Sets one stream up, not streaming yet. An empty size leaves what libcamera proposes. Both may
    // be adjusted by the driver: the answer says what it is now.
    virtual LibcameraStream configure(const std::string& format, cv::Size size) = 0;

    // Starts the stream with every buffer in a request of its own. The i-th of these requests
    // carries controls[i].
    virtual void start(const std::vector<LibcameraValues>& controls) = 0;

    // The next request that comes back; nothing if none does within `at_most`, or if the camera was
    // disconnected. Throws Interrupted as soon as a stop is requested.
    virtual std::optional<LibcameraFrame> next(Duration at_most, const std::stop_token& stop) = 0;

    virtual void give_back(int buffer) = 0;

    virtual KernelTime time() const = 0;

    // Whether libcamera has said that the device is gone. Safe from every thread.
    virtual bool disconnected() const = 0;

    // Whether the kernel says so, for a camera that has fallen silent: libcamera hears of it from
    // udev, later or never. True as well when it is another video device of this process.
    virtual bool is_silently_gone() const = 0;

    // Ends the stream; nothing if there is none. May take as long as the driver likes, and as long
    // as libcamera needs to hear that the device is gone.
    virtual void stop() noexcept = 0;
};

// `id` as `etalon devices` prints it. Throws DeviceError when there is no such camera or another
// program has it.
std::unique_ptr<LibcameraDevice> open_libcamera_device(const std::string& id);

// Takes about a tenth of a second. Empty where libcamera cannot look.
std::vector<CameraIdentity> list_libcamera_cameras();

// What the libcamera backend decides without a device: which format and which values to ask for,
// what the frames' metadata say about them, and when an exposure began.

// ---- formats -------------------------------------------------------------------------------

// The table's row for what is wished for, out of the names that a camera offers: the one that was
// named, or else a monochrome one that holds the bits, the one with the fewest. Null if there is
// none.
const PixelFormat* choose_libcamera_format(const CaptureSettings& wanted,
                                           const std::vector<LibcameraFormat>& offered);

// The difference between a configured stream and what was asked for.
std::optional<SettingDifference> stream_difference(const std::string& format, cv::Size size,
                                                   const LibcameraStream& stream);

// ---- controls ------------------------------------------------------------------------------

struct LibcameraPlan {
    LibcameraValues automatics;  // values at which automatic and enhancing functions do nothing
    LibcameraValues asked;       // what the settings ask for, in libcamera's names and units
    std::vector<std::string> remarks;  // on functions that cannot be switched off
};

// Of what is offered only; an asked-for control that is not, or not in that range, is a difference.
struct LibcameraPlanning {
    LibcameraPlan plan;
    std::optional<SettingDifference> difference;
};
LibcameraPlanning plan_libcamera_controls(const CaptureSettings& wanted,
                                          const std::map<std::string, LibcameraRange>& offered);

// The first asked-for value, in words, that a frame's metadata contradict; nothing if none. What
// they do not mention is not contradicted.
std::optional<SettingDifference> contradicted(const LibcameraValues& asked,
                                              const LibcameraValues& metadata,
                                              double exposure_step_us);

// "exposure 5000 us", "gain 6 dB", "Contrast 1.5".
std::string in_words(const std::string& control, double value);

// Analogue gain is a factor in libcamera.
double gain_factor(double gain_db);
double gain_db(double gain_factor);

// ---- time ----------------------------------------------------------------------------------

// Tells how old a SensorTimestamp is. Its definition says CLOCK_BOOTTIME, in every version, but
// pipelines hand on the kernel drivers' stamps, which are CLOCK_MONOTONIC. The two differ by the
// time that the machine was suspended, and a stamp that lies in the monotonic clock's future gives
// away which it is. For less than a second of it, that time is uncertainty instead.
class SensorClock {
public:
    struct Age {
        Duration age;  // negative for a stamp in the future
        Duration uncertainty;
    };
    Age age(std::int64_t stamp_ns, const KernelTime& now);

private:
    bool counts_suspension_ = false;
};

// Says of each frame of a stream when its exposure began. The stamp is the readout's beginning, so
// the exposure began within the ExposureTime before it. A frame that does not tell that comes from
// a USB camera, of which UsbDelay tells.
class FrameTiming {
public:
    struct Start {
        std::string fault;  // why the stamp cannot be believed; empty: it can
        Instant earliest = Instant::min(), latest = Instant::min();  // on the station's clock
    };
    // Frames in the order in which they came. `now` and `station_now` are the same moment. Where
    // nothing is known of the earliest beginning it stays at the beginning of time.
    Start place(const LibcameraFrame& frame, const KernelTime& now, Instant station_now);

    // The mean since the stream began, once known.
    std::optional<Duration> period() const;

private:
    struct Stamp {
        std::uint64_t sequence;
        std::int64_t time_ns;
    };
    std::optional<Duration> longest_age(const LibcameraFrame& frame) const;

    SensorClock clock_;
    std::optional<Stamp> first_, last_;
    UsbDelay usb_delay_;
};

}  // namespace etalon
