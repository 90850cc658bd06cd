// Mean and variance of a pixel over frames of a scene at rest in steady light: the mean has less
// noise, the variance is the camera's temporal noise.
#pragma once

#include <fmt/format.h>

#include <cmath>
#include "capture/frame/camera.h"

namespace etalon {

struct FrameAverage {
    cv::Mat mean;      // CV_64FC1, code values
    cv::Mat variance;  // CV_64FC1, code values squared; of one frame, divided by frames - 1
    int frames = 0;
    int bits = 0;  // of the frames' codes

    // Root of the mean variance over all pixels, in code values.
    double noise() const { return std::sqrt(cv::mean(variance)[0]); }
};

// Collects frames one by one. Sums run in double after Welford, so that 16-bit codes lose nothing.
class FrameAverager {
public:
    // A complete frame. Throws ConfigError for one of another size than the first.
    void add(const Frame& frame) {
        // Welford, Technometrics 4 (1962) 419.
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
    int frames() const { return sum_.frames; }
    // Of at least 2 frames; throws ConfigError otherwise.
    FrameAverage average() const {
        if (sum_.frames < 2)
            throw ConfigError(
                {},
                fmt::format("an average of {} frames has no noise: 2 are the least", sum_.frames));
        FrameAverage average = sum_;
        average.mean = sum_.mean.clone();
        average.variance = sum_.variance / (sum_.frames - 1);
        return average;
    }

private:
    FrameAverage sum_;  // variance: the sum of squared deviations
};

}  // namespace etalon
