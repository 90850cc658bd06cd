#include "capture/genicam/genicam_clock.h"

#include <arv.h>

namespace etalon {
namespace {

constexpr std::chrono::milliseconds latch_timeout{50};

struct LatchFeatures {
    const char* command;
    const char* value;
    bool in_ticks;  // of GevTimestampTickFrequency, instead of ns
};

// SFNC 2, then GigE Vision 1.
std::optional<LatchFeatures> latch_features(const GenicamDevice& device) {
    for (const LatchFeatures& features :
         {LatchFeatures{"TimestampLatch", "TimestampLatchValue", false},
          LatchFeatures{"GevTimestampControlLatch", "GevTimestampValue", true}})
        if (device.has(features.command) && device.has(features.value))
            return features;
    return std::nullopt;
}

std::uint64_t latched_value(const GenicamDevice& device, const LatchFeatures& features) {
    return static_cast<std::uint64_t>(device.ask("read the latched time", [&](GError** e) {
        return arv_camera_get_integer(device.camera(), features.value, e);
    }));
}

std::uint64_t in_nanoseconds(const GenicamDevice& device, const LatchFeatures& features,
                             std::uint64_t value) {
    if (!features.in_ticks || !arv_camera_is_gv_device(device.camera()))
        return value;
    const std::uint64_t frequency = genicam_tick_frequency(device);
    if (frequency == 0)
        device.fail("read the tick frequency", "it is 0");
    return nanoseconds_of_ticks(value, frequency);
}

// SFNC 2, then what cameras had before it.
struct PtpFeatures {
    const char* enable;
    const char* latch;
    const char* status;
    const char* offset;
};
constexpr PtpFeatures ptp_features[] = {
    {"PtpEnable", "PtpDataSetLatch", "PtpStatus", "PtpOffsetFromMaster"},
    {"GevIEEE1588", "GevIEEE1588DataSetLatch", "GevIEEE1588Status", "GevIEEE1588OffsetFromMaster"}};

bool is_switched_off(const GenicamDevice& device, const PtpFeatures& features) {
    return device.has(features.enable) && !device.ask("read whether PTP is on", [&](GError** e) {
        return arv_camera_get_boolean(device.camera(), features.enable, e);
    });
}

PtpState ptp_state(const GenicamDevice& device, const PtpFeatures& features) {
    ArvCamera* camera = device.camera();
    if (device.has(features.latch))
        device.ask("latch the PTP state",
                   [&](GError** e) { arv_camera_execute_command(camera, features.latch, e); });
    PtpState state;
    const char* status = device.ask("read the PTP state", [&](GError** e) {
        return arv_camera_get_string(camera, features.status, e);
    });
    state.status = status ? status : "";
    if (state.status == "Slave" && device.has(features.offset))
        state.offset_ns = device.ask("read the PTP offset", [&](GError** e) {
            return arv_camera_get_integer(camera, features.offset, e);
        });
    return state;
}

}  // namespace

std::uint64_t genicam_tick_frequency(const GenicamDevice& device) {
    if (!arv_camera_is_gv_device(device.camera()))
        return 0;
    return device.ask("read the tick frequency", [&](GError** e) {
        return arv_gv_device_get_timestamp_tick_frequency(
            ARV_GV_DEVICE(arv_camera_get_device(device.camera())), e);
    });
}

std::uint64_t nanoseconds_of_ticks(std::uint64_t ticks, std::uint64_t frequency) {
    if (frequency == 0)
        return ticks;
    const std::uint64_t seconds = ticks / frequency, rest = ticks % frequency;
    return seconds * 1'000'000'000 + rest * 1'000'000'000 / frequency;
}

// A device may take its time to latch, so the clock counts as read when the value has changed: it
// lies between sending the command and seeing that.
std::optional<GenicamClockReading> read_genicam_clock(const GenicamDevice& device,
                                                      const Clock& clock) {
    const auto features = latch_features(device);
    if (!features)
        return std::nullopt;
    const std::uint64_t old_value = latched_value(device, *features);
    const Instant before = clock.now();
    device.ask("latch the device's clock", [&](GError** e) {
        arv_camera_execute_command(device.camera(), features->command, e);
    });
    do {
        const std::uint64_t value = latched_value(device, *features);
        if (value != old_value)
            return GenicamClockReading{in_nanoseconds(device, *features, value),
                                       {before, clock.now()}};
    } while (clock.now() < before + latch_timeout);
    return std::nullopt;
}

std::optional<PtpState> read_ptp(const GenicamDevice& device) {
    for (const PtpFeatures& features : ptp_features) {
        if (!device.has(features.status) || is_switched_off(device, features))
            continue;
        PtpState state = ptp_state(device, features);
        if (state.status != "Disabled" && state.status != "Off")
            return state;
    }
    return std::nullopt;
}

}  // namespace etalon
