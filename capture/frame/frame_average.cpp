#include "capture/frame/frame_average.h"

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

}  // namespace

double FrameAverage::noise() const {
    return std::sqrt(cv::mean(variance)[0]);
}

// Welford, Technometrics 4 (1962) 419.
void FrameAverager::add(const Frame& frame) {
    const cv::Mat& codes = frame.image.pixels;
    if (sum_.frames == 0) {
        sum_.mean = cv::Mat::zeros(codes.size(), CV_64FC1);
        sum_.variance = sum_.mean.clone();
        sum_.bits = frame.image.bits;
        sum_.first_exposure_start = frame.exposure_start;
    } else if (codes.size() != sum_.mean.size()) {
        throw ConfigError({}, "a frame has another size than the first of the average");
    }
    ++sum_.frames;
    cv::Mat from_old_mean, from_new_mean;
    cv::subtract(codes, sum_.mean, from_old_mean, cv::noArray(), CV_64F);
    sum_.mean += from_old_mean / sum_.frames;
    cv::subtract(codes, sum_.mean, from_new_mean, cv::noArray(), CV_64F);
    sum_.variance += from_old_mean.mul(from_new_mean);
    sum_.last_exposure_start = frame.exposure_start;
}

FrameAverage FrameAverager::average() const {
    if (sum_.frames < 2)
        throw ConfigError(
            {}, fmt::format("an average of {} frames has no noise: 2 are the least", sum_.frames));
    FrameAverage average = sum_;
    average.mean = sum_.mean.clone();
    average.variance = sum_.variance / (sum_.frames - 1);
    return average;
}

FrameAverage average_frames(Camera& camera, int frames, Instant t, int retries,
                            std::stop_token stop) {
    if (frames < 2)
        throw ConfigError(
            {}, fmt::format("an average of {} frames has no noise: 2 are the least", frames));
    FrameAverager averager;
    for (Instant after = t; averager.frames() < frames;) {
        const Frame frame = complete_frame(camera, after, retries, stop);
        averager.add(frame);
        after = frame.exposure_start;
    }
    return averager.average();
}

}  // namespace etalon
