#include "capture/libcamera/libcamera_support.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace etalon {
namespace {

struct Neutral {
    const char* control;
    double value;
};

// libcamera's definitions of the controls say these values. Modes: manual or off.
constexpr std::array<Neutral, 14> neutral_values = {{
    {"AeEnable", 0},
    {"ExposureTimeMode", 1},
    {"AnalogueGainMode", 1},
    {"AeFlickerMode", 0},
    {"AwbEnable", 0},
    {"AfMode", 0},
    {"HdrMode", 0},
    {"WdrMode", 0},
    {"NoiseReductionMode", 0},
    {"Sharpness", 0},
    {"Brightness", 0},
    {"Contrast", 1},
    {"Saturation", 1},
    {"Gamma", 1},
}};

LibcameraValues asked_values(const CaptureSettings& wanted) {
    LibcameraValues asked(wanted.controls.begin(), wanted.controls.end());
    if (wanted.exposure.count())
        asked["ExposureTime"] = static_cast<double>(wanted.exposure.count());
    asked["AnalogueGain"] = gain_factor(wanted.gain_db);
    return asked;
}

std::optional<double> value_in(const LibcameraValues& values, const char* control) {
    const auto found = values.find(control);
    return found == values.end() ? std::nullopt : std::optional(found->second);
}

// What the difference between two readings of one control may be: the step of the exposure, that of
// the gain (0.05 dB), else rounding to the sensor's own steps.
double tolerance(const std::string& control, double value, double exposure_step_us) {
    if (control == "ExposureTime")
        return exposure_step_us;
    if (control == "AnalogueGain")
        return value * (gain_factor(0.05) - 1.0);
    return 0.005 * std::abs(value);
}

}  // namespace

// ---- formats -------------------------------------------------------------------------------

const PixelFormat* choose_libcamera_format(const CaptureSettings& wanted,
                                           const std::vector<LibcameraFormat>& offered) {
    const PixelFormat* chosen = nullptr;
    for (const LibcameraFormat& format : offered) {
        const PixelFormat* known = find_libcamera_format(format.name);
        if (!known || known->bits < wanted.bits)
            continue;
        if (format.name == wanted.format)
            return known;
        const bool same_container = (known->bits <= 8) == (wanted.bits <= 8);
        const bool monochrome = known->mosaic == Mosaic::none && !known->lossy();
        if (wanted.format.empty() && same_container && monochrome &&
            (!chosen || known->bits < chosen->bits))
            chosen = known;
    }
    return chosen;
}

std::optional<SettingDifference> stream_difference(const std::string& format, cv::Size size,
                                                   const LibcameraStream& stream) {
    if (stream.format != format)
        return SettingDifference{"set pixel format " + format,
                                 "libcamera adjusts it to " + stream.format};
    if ((size.width && size.width != stream.size.width) ||
        (size.height && size.height != stream.size.height))
        return SettingDifference{
            fmt::format("set image size {}x{}", size.width, size.height),
            fmt::format("libcamera adjusts it to {}x{}", stream.size.width, stream.size.height)};
    return std::nullopt;
}

// ---- controls ------------------------------------------------------------------------------

LibcameraPlanning plan_libcamera_controls(const CaptureSettings& wanted,
                                          const std::map<std::string, LibcameraRange>& offered) {
    LibcameraPlan plan;
    for (const auto& [control, neutral] : neutral_values) {
        const auto range = offered.find(control);
        if (range == offered.end() || wanted.controls.count(control))
            continue;
        const double nearest = std::clamp(neutral, range->second.low, range->second.high);
        plan.automatics[control] = nearest;
        if (nearest != neutral)
            plan.remarks.push_back(
                fmt::format("{} stays at {}: it cannot be switched off", control, nearest));
    }
    for (const auto& [control, value] : asked_values(wanted)) {
        const auto range = offered.find(control);
        const bool wish_for_nothing = control == "AnalogueGain" && wanted.gain_db == 0.0;
        if (range == offered.end() && wish_for_nothing)
            continue;
        const std::string request = "set " + in_words(control, value);
        if (range == offered.end())
            return {plan, SettingDifference{request, "the camera has no control " + control}};
        const auto& [low, high, standard] = range->second;
        if (value < low || value > high)
            return {plan, SettingDifference{
                              request, fmt::format("possible are {} to {}", in_words(control, low),
                                                   in_words(control, high))}};
        plan.asked[control] = value;
    }
    return {plan, std::nullopt};
}

std::optional<SettingDifference> contradicted(const LibcameraValues& asked,
                                              const LibcameraValues& metadata,
                                              double exposure_step_us) {
    for (const auto& [control, value] : asked) {
        const auto actual = metadata.find(control);
        if (actual != metadata.end() &&
            !(std::abs(actual->second - value) <= tolerance(control, value, exposure_step_us)))
            return SettingDifference{"set " + in_words(control, value),
                                     "the frames say " + in_words(control, actual->second)};
    }
    return std::nullopt;
}

std::string in_words(const std::string& control, double value) {
    if (control == "ExposureTime")
        return fmt::format("exposure {} us", value);
    if (control == "AnalogueGain")
        return fmt::format("gain {:.4g} dB", gain_db(value));
    return fmt::format("{} {:.6g}", control, value);
}

double gain_factor(double gain_db) {
    return std::pow(10.0, gain_db / 20.0);
}

double gain_db(double gain_factor) {
    return 20.0 * std::log10(gain_factor);
}

// ---- time ----------------------------------------------------------------------------------

SensorClock::Age SensorClock::age(std::int64_t stamp_ns, const KernelTime& now) {
    using std::chrono::nanoseconds;
    constexpr nanoseconds too_short_to_tell = std::chrono::seconds(1);
    const nanoseconds suspended(now.boot_ns - now.monotonic_ns);
    counts_suspension_ = counts_suspension_ || stamp_ns > now.monotonic_ns;
    const std::int64_t reference = counts_suspension_ ? now.boot_ns : now.monotonic_ns;
    return {nanoseconds(reference - stamp_ns),
            suspended < too_short_to_tell ? std::max(suspended, nanoseconds(0)) : nanoseconds(0)};
}

std::optional<Duration> FrameTiming::period() const {
    if (!first_ || last_->sequence <= first_->sequence)
        return std::nullopt;
    const auto frames = static_cast<std::int64_t>(last_->sequence - first_->sequence);
    return std::chrono::nanoseconds((last_->time_ns - first_->time_ns) / frames);
}

// How long before its stamp the exposure of the newest frame may have begun.
std::optional<Duration> FrameTiming::longest_age(const LibcameraFrame& frame) const {
    if (const auto exposure = value_in(frame.metadata, "ExposureTime"))
        return std::chrono::microseconds(std::llround(*exposure));
    return usb_delay_.longest();
}

FrameTiming::Start FrameTiming::place(const LibcameraFrame& frame, const KernelTime& now,
                                      Instant station_now) {
    if (!frame.timestamp_ns)
        return {"the frame has no SensorTimestamp"};
    const Stamp stamp{frame.sequence, *frame.timestamp_ns};
    usb_delay_.came(frame.sequence, std::chrono::nanoseconds(stamp.time_ns));
    const auto before = std::exchange(last_, stamp);
    if (before && stamp.time_ns <= before->time_ns) {
        first_ = stamp;
        return {fmt::format("stamped {} ns before the frame that came before it",
                            before->time_ns - stamp.time_ns)};
    }
    if (!first_)
        first_ = stamp;
    const SensorClock::Age stamped = clock_.age(stamp.time_ns, now);
    if (stamped.age + stamped.uncertainty < Duration(0))
        return {fmt::format("stamped {} ns in the future", -stamped.age.count())};
    Start start;
    start.latest = std::min(station_now - stamped.age + stamped.uncertainty, station_now);
    if (const auto longest = longest_age(frame))
        start.earliest = station_now - stamped.age - stamped.uncertainty - *longest;
    return start;
}

}  // namespace etalon
