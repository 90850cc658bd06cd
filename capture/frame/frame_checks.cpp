#include "capture/frame/frame_checks.h"

#include <fmt/format.h>

#include <cmath>
#include <future>
#include <thread>

namespace etalon {
namespace {

constexpr std::uint64_t wrapping_ids = 65535;  // 1..65535, then 1 again

// Steps from `last` forward to `id`, both wrapping ones.
std::uint64_t ahead(std::uint64_t last, std::uint64_t id) {
    return (id + wrapping_ids - last) % wrapping_ids;
}

// The full scale is all ones, so a code above it has a bit that lies above.
template <typename Code>
bool has_bit_above(const cv::Mat& pixels, int full_scale) {
    Code bits = 0;
    for (int y = 0; y < pixels.rows; ++y) {
        const Code* row = pixels.ptr<Code>(y);
        for (int x = 0; x < pixels.cols; ++x)
            bits = static_cast<Code>(bits | row[x]);
    }
    return bits > full_scale;
}

bool nearly_equal(double a, double b) {
    return std::abs(a - b) <= 1e-6 * std::max(std::abs(a), std::abs(b));
}

std::optional<SettingDifference> control_difference(const CaptureSettings& wanted,
                                                    const CaptureSettings& actual) {
    for (const auto& [control, value] : wanted.controls) {
        const auto found = actual.controls.find(control);
        if (found == actual.controls.end() || !nearly_equal(found->second, value))
            return SettingDifference{fmt::format("set {} to {}", control, value),
                                     found == actual.controls.end()
                                         ? "the device has no such control"
                                         : fmt::format("the device uses {}", found->second)};
    }
    return std::nullopt;
}

}  // namespace

bool frame_id_advanced(std::uint64_t last, std::uint64_t id) {
    if (last > wrapping_ids || id > wrapping_ids)
        return id > last;
    return ahead(last, id) > 0 && ahead(last, id) <= wrapping_ids / 2;
}

std::uint64_t frames_between(std::uint64_t last, std::uint64_t id) {
    return (last > wrapping_ids || id > wrapping_ids ? id - last : ahead(last, id)) - 1;
}

bool bits_fit_depth(int bits, int cv_depth) {
    return cv_depth == CV_8U ? bits >= 1 && bits <= 8
                             : cv_depth == CV_16U && bits >= 9 && bits <= 16;
}

bool can_exceed_full_scale(const PixelFormat& format, int bits) {
    return bits < format.bits || (format.packing == PixelPacking::words_low && bits < 16);
}

bool exceeds_full_scale(const CodeImage& image) {
    return image.pixels.depth() == CV_8U
               ? has_bit_above<std::uint8_t>(image.pixels, image.full_scale())
               : has_bit_above<std::uint16_t>(image.pixels, image.full_scale());
}

std::string code_fault(const CodeImage& image, const PixelFormat& format) {
    if (!can_exceed_full_scale(format, image.bits) || !exceeds_full_scale(image))
        return "";
    return fmt::format(
        "a code is above {}: the device does not send {} bits in the low bits of a pixel",
        image.full_scale(), image.bits);
}

void unpack_into(Frame& frame, const PixelFormat& format, const RawImage& raw, int bits) {
    const std::string fault = unpack(format, raw, frame.image);
    frame.status = fault.empty() ? FrameStatus::complete : FrameStatus::short_frame;
    if (fault.empty())
        frame.image.bits = bits;
    else
        frame.status_detail = fault;
}

std::optional<SettingDifference> first_difference(const CaptureSettings& wanted,
                                                  const CaptureSettings& actual,
                                                  double exposure_step_us) {
    const auto differs = [](const std::string& request, const auto& used) {
        return SettingDifference{"set " + request, fmt::format("the device uses {}", used)};
    };
    if ((wanted.width && wanted.width != actual.width) ||
        (wanted.height && wanted.height != actual.height))
        return differs(fmt::format("image size {}x{}", wanted.width, wanted.height),
                       fmt::format("{}x{}", actual.width, actual.height));
    if (wanted.bits && wanted.bits != actual.bits)
        return differs(fmt::format("{} bits a pixel", wanted.bits), actual.bits);
    if (!wanted.format.empty() && wanted.format != actual.format)
        return differs("pixel format " + wanted.format, actual.format);
    const auto wanted_us = wanted.exposure.count(), actual_us = actual.exposure.count();
    if (wanted_us && std::abs(static_cast<double>(actual_us - wanted_us)) > exposure_step_us)
        return differs(fmt::format("exposure {} us", wanted_us), fmt::format("{} us", actual_us));
    if (!wanted.trigger.empty() && wanted.trigger != actual.trigger)
        return differs("trigger " + wanted.trigger,
                       actual.trigger.empty() ? "none" : actual.trigger);
    if (!(std::abs(actual.gain_db - wanted.gain_db) <= 0.05))
        return differs(fmt::format("gain {} dB", wanted.gain_db),
                       fmt::format("{} dB", actual.gain_db));
    if (wanted.black_level && !actual.black_level)
        return SettingDifference{fmt::format("set black level {}", *wanted.black_level),
                                 "the device has none"};
    if (wanted.black_level && !nearly_equal(*wanted.black_level, *actual.black_level))
        return differs(fmt::format("black level {}", *wanted.black_level), *actual.black_level);
    return control_difference(wanted, actual);
}

bool run_bounded(std::function<void()> task, Duration limit) noexcept {
    const auto done = std::make_shared<std::promise<void>>();
    const std::future<void> is_done = done->get_future();
    const auto job = std::make_shared<std::function<void()>>(std::move(task));
    const auto run = [job, done] {
        (*job)();
        *job = nullptr;  // what it owned is gone when it is done
        done->set_value();
    };
    try {
        std::thread(run).detach();
    } catch (const std::system_error&) {
        run();  // no thread to be had
    }
    return is_done.wait_for(limit) == std::future_status::ready;
}

void wait_until_after(Clock& clock, Instant t, std::stop_token stop) {
    while (clock.now() <= t)
        if (!clock.wait_until(t + Duration(1), stop))
            throw Interrupted();
    throw_if_stopped(stop);
}

}  // namespace etalon
