#include "capture/frame_checks.h"

#include <fmt/format.h>

#include <cmath>

#include "core/errors.h"

namespace etalon {

bool frame_id_advanced(std::uint64_t last, std::uint64_t id) {
    constexpr std::uint64_t ids = 65535;  // 1..65535, then 1 again
    if (last > ids || id > ids)
        return id > last;
    const std::uint64_t ahead = (id + ids - last) % ids;
    return ahead > 0 && ahead <= ids / 2;
}

bool bits_fit_depth(int bits, int cv_depth) {
    return cv_depth == CV_8U ? bits >= 1 && bits <= 8
                             : cv_depth == CV_16U && bits >= 9 && bits <= 16;
}

bool exceeds_full_scale(const CodeImage& image) {
    double highest = 0.0;
    cv::minMaxLoc(image.pixels, nullptr, &highest);
    return highest > image.full_scale();
}

std::optional<SettingDifference> first_difference(const CaptureSettings& wanted,
                                                  const CaptureSettings& actual,
                                                  double exposure_step_us) {
    if ((wanted.width && wanted.width != actual.width) ||
        (wanted.height && wanted.height != actual.height))
        return SettingDifference{fmt::format("set image size {}x{}", wanted.width, wanted.height),
                                 fmt::format("the device uses {}x{}", actual.width, actual.height)};
    const double exposure_error =
        std::abs(static_cast<double>((actual.exposure - wanted.exposure).count()));
    if (wanted.exposure.count() && exposure_error > exposure_step_us)
        return SettingDifference{fmt::format("set exposure {} us", wanted.exposure.count()),
                                 fmt::format("the device uses {} us", actual.exposure.count())};
    if (!(std::abs(actual.gain_db - wanted.gain_db) <= 0.05))
        return SettingDifference{fmt::format("set gain {} dB", wanted.gain_db),
                                 fmt::format("the device uses {} dB", actual.gain_db)};
    return std::nullopt;
}

void wait_until_after(Clock& clock, Instant t, std::stop_token stop) {
    while (clock.now() <= t)
        if (!clock.wait_until(t + Duration(1), stop))
            throw Interrupted();
    if (stop.stop_requested())
        throw Interrupted();
}

}  // namespace etalon
