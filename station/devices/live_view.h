// What a person who sets a camera up wants to see of its frames, in a line of 80 columns.
#pragma once

#include "core/image/image.h"

namespace etalon {

struct LiveFigures {
    double frames_per_second = 0.0;  // of the frames' exposures, smoothed over about 10 of them
    double mean = 0.0;               // code values
    double noise = 0.0;      // standard deviation in time, code values; of the last two frames
    double saturated = 0.0;  // part of the pixels at full scale
    double sharpness = 0.0;  // root mean square of the second differences over the mean, per mille
    long bad = 0;            // incomplete frames so far
};

class LiveView {
public:
    // Costs about five passes over the image.
    void add(const Frame& frame);
    const LiveFigures& figures() const { return figures_; }
    // At most 79 columns; says that nothing came where that is so.
    std::string line() const;

private:
    LiveFigures figures_;
    FrameStatus last_status_ = FrameStatus::timed_out;
    cv::Mat last_;
    Instant last_start_{};
};

}  // namespace etalon
