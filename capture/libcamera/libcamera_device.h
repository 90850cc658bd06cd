// One libcamera camera in plain types, so that tests can script one. It does not judge frames. Only
// what libcamera 0.0.3 and all later versions have is used; controls and formats go by their names.
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

// The clocks that a SensorTimestamp may refer to, read together; suspension counts in `boot_ns`.
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

    // Sets one stream up. An empty size: libcamera's proposal. The answer says what it is now.
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

    // Ends the stream, if any. May take as long as the driver and libcamera like.
    virtual void stop() noexcept = 0;
};

// `id` as `etalon devices` prints it. Throws DeviceError when there is no such camera or another
// program has it.
std::unique_ptr<LibcameraDevice> open_libcamera_device(const std::string& id);

// Takes about a tenth of a second. Empty where libcamera cannot look.
std::vector<CameraIdentity> list_libcamera_cameras();

// What is decided without a device: formats, values, what metadata say, when an exposure began.
// ---- formats -------------------------------------------------------------------------------

// Of the offered names the wished one's row, or else the monochrome one with the fewest bits that
// holds the wish. Null if there is none.
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

// The first asked-for value that the metadata contradict, in words; nothing where they say nothing.
std::optional<SettingDifference> contradicted(const LibcameraValues& asked,
                                              const LibcameraValues& metadata,
                                              double exposure_step_us);

// "exposure 5000 us", "gain 6 dB", "Contrast 1.5".
std::string in_words(const std::string& control, double value);

// Analogue gain is a factor in libcamera.
double gain_factor(double gain_db);
double gain_db(double gain_factor);

// ---- time ----------------------------------------------------------------------------------

// How old a SensorTimestamp is. By definition CLOCK_BOOTTIME, but pipelines hand on the drivers'
// CLOCK_MONOTONIC stamps. A stamp in the monotonic clock's future gives away which; less than a
// second of suspension is uncertainty instead.
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

// When each frame's exposure began. The stamp is the readout's beginning: the exposure began within
// the ExposureTime before; without that it is a USB camera's frame (UsbDelay).
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
