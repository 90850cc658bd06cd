#include "capture/frame/frame_average.h"

#include <fmt/format.h>

#include <cmath>

namespace etalon {

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
    } else if (codes.size() != sum_.mean.size()) {
        throw ConfigError({}, "a frame has another size than the first of the average");
    }
    ++sum_.frames;
    cv::Mat from_old_mean, from_new_mean;
    cv::subtract(codes, sum_.mean, from_old_mean, cv::noArray(), CV_64F);
    sum_.mean += from_old_mean / sum_.frames;
    cv::subtract(codes, sum_.mean, from_new_mean, cv::noArray(), CV_64F);
    sum_.variance += from_old_mean.mul(from_new_mean);
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

}  // namespace etalon
