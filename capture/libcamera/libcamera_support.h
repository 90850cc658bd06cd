// What the libcamera backend decides without a device: which format and which values to ask for,
// what the frames' metadata say about them, and when an exposure began.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "capture/frame/frame_checks.h"
#include "capture/frame/pixel_formats.h"
#include "capture/libcamera/libcamera_device.h"
#include "capture/v4l2/usb_delay.h"

namespace etalon {

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
// a USB camera, of which usb_delay.h tells.
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
