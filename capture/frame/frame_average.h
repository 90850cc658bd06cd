// Mean and variance of a pixel over frames of a scene that stands still: the mean is what less
// noisy measurements start from, the variance is the camera's temporal noise. Not for scenes that
// move or lights that flicker: both would pass for noise.
#pragma once

#include "capture/frame/camera.h"

namespace etalon {

struct FrameAverage {
    cv::Mat mean;      // CV_64FC1, code values
    cv::Mat variance;  // CV_64FC1, code values squared; of one frame, divided by frames - 1
    int frames = 0;
    int bits = 0;  // of the frames' codes

    // Root of the mean variance over all pixels, in code values.
    double noise() const;
};

// Collects frames one by one. Sums run in double after Welford, so that 16-bit codes lose nothing.
class FrameAverager {
public:
    // A complete frame. Throws ConfigError for one of another size than the first.
    void add(const Frame& frame);
    int frames() const { return sum_.frames; }
    // Of at least 2 frames; throws ConfigError otherwise.
    FrameAverage average() const;

private:
    FrameAverage sum_;  // variance: the sum of squared deviations
};

}  // namespace etalon
