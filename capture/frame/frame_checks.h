// The tests that decide whether a frame, and the settings that it is taken with, are what was asked
// for. Shared by the backends.
#pragma once

#include <functional>

#include "capture/frame/camera.h"
#include "capture/frame/pixel_formats.h"

namespace etalon {

// Whether frame `id` comes after `last` on a GigE Vision stream. Block ids (1.x) count 1..65535 and
// wrap to 1; ahead by less than half of that is later. Ids above 65535 (2, USB3 Vision) never wrap.
bool frame_id_advanced(std::uint64_t last, std::uint64_t id);

// How many ids lie between frame `last` and the later frame `id`: frames that never came.
std::uint64_t frames_between(std::uint64_t last, std::uint64_t id);

// Whether the images' container can hold codes of `bits` bits: 8-bit pixels 1..8, 16-bit 9..16.
bool bits_fit_depth(int bits, int cv_depth);

// Whether a code value lies above the full scale, which means that the device aligns its codes to
// the high bits or has more bits than was said. Reads every pixel.
bool exceeds_full_scale(const CodeImage& image);

// Whether codes above the full scale can occur at all: packed codes have no room for them.
bool can_exceed_full_scale(const PixelFormat& format, int bits);

// In words: codes exceed the full scale; empty if not. Another frame would not help.
std::string code_fault(const CodeImage& image, const PixelFormat& format);

// Unpacks the data of a frame, of which `bits` a pixel are in use: `complete`, or `short_frame`
// with what is wrong.
void unpack_into(Frame& frame, const PixelFormat& format, const RawImage& raw, int bits);

// A wish that a device did not fulfil, in the words of a DeviceError.
struct SettingDifference {
    std::string request;  // "set gain 2.5 dB"
    std::string cause;    // "the device uses 2 dB"
};

// The first that differs of size, bits, format, exposure (by more than `exposure_step_us`), gain
// (by 0.05 dB; cameras' coarsest usual step is 0.1 dB), black level, trigger and controls (by 1e-6
// of themselves). Size, bits and exposure 0, and empty wishes, are none.
std::optional<SettingDifference> first_difference(const CaptureSettings& wanted,
                                                  const CaptureSettings& actual,
                                                  double exposure_step_us);

// The retries of Camera::frame_after(): takes and counts frames until one is complete, at most 1 +
// `retries`. Otherwise the last that came, if any did: its camera is not gone.
template <class Take>
Frame first_complete_frame(int retries, CaptureStatistics& statistics, const Take& take) {
    Frame last;
    for (int attempt = 0; attempt <= retries; ++attempt) {
        Frame frame = take();
        if (frame.status == FrameStatus::complete) {
            ++statistics.delivered;
            return frame;
        }
        ++statistics.rejected;
        if (attempt == 0 || frame.status != FrameStatus::timed_out)
            last = std::move(frame);
    }
    return last;
}

// Runs what a hanging driver may never end. True when it is done; after `limit` false, and it goes
// on in the background, so it must own all that it touches.
bool run_bounded(std::function<void()> task, Duration limit) noexcept;

// Returns once the clock is past t. Throws Interrupted when a stop is requested.
void wait_until_after(Clock& clock, Instant t, std::stop_token stop);

}  // namespace etalon
