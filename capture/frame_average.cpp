#include "capture/frame_average.h"

#include <fmt/format.h>

#include <cmath>

#include "core/errors.h"

namespace etalon {
namespace {

Frame complete_frame(Camera& camera, Instant t, int retries, std::stop_token stop) {
    Frame frame = camera.frame_after(t, retries, std::move(stop));
    if (frame.status != FrameStatus::complete)
        throw DeviceError("camera " + camera.identity().uri, "take frames for an average",
                          fmt::format("one is {}: {}", name(frame.status), frame.status_detail));
    return frame;
}

// Welford, Technometrics 4 (1962) 419. `average.variance` holds the sum of squared deviations here.
void add(const cv::Mat& codes, FrameAverage& average) {
    ++average.frames;
    cv::Mat from_old_mean, from_new_mean;
    cv::subtract(codes, average.mean, from_old_mean, cv::noArray(), CV_64F);
    average.mean += from_old_mean / average.frames;
    cv::subtract(codes, average.mean, from_new_mean, cv::noArray(), CV_64F);
    average.variance += from_old_mean.mul(from_new_mean);
}

}  // namespace

double FrameAverage::noise() const {
    return std::sqrt(cv::mean(variance)[0]);
}

FrameAverage average_frames(Camera& camera, int frames, Instant t, int retries,
                            std::stop_token stop) {
    if (frames < 2)
        throw ConfigError(
            {}, fmt::format("an average of {} frames has no noise: 2 are the least", frames));
    FrameAverage average;
    for (Instant after = t; average.frames < frames; after = average.last_exposure_start) {
        const Frame frame = complete_frame(camera, after, retries, stop);
        if (average.frames == 0) {
            average.mean = cv::Mat::zeros(frame.image.pixels.size(), CV_64FC1);
            average.variance = average.mean.clone();
            average.bits = frame.image.bits;
            average.first_exposure_start = frame.exposure_start;
        } else if (frame.image.pixels.size() != average.mean.size()) {
            throw DeviceError("camera " + camera.identity().uri, "take frames for an average",
                              "a frame has another size than the first");
        }
        add(frame.image.pixels, average);
        average.last_exposure_start = frame.exposure_start;
    }
    average.variance /= average.frames - 1;
    return average;
}

}  // namespace etalon
