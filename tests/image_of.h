// Images by a function of their pixels; a gray.
#pragma once

#include <opencv2/core.hpp>

#include "core/statistics/random.h"

namespace etalon::test {

inline constexpr double gray = 1.0 / 255.0;  // of linear full scale

// CV_32FC1 of value(x, y), which is called row by row.
template <class Value>
cv::Mat image_of(cv::Size size, const Value& value) {
    cv::Mat image(size, CV_32FC1);
    for (int y = 0; y < size.height; ++y)
        for (int x = 0; x < size.width; ++x)
            image.at<float>(y, x) = static_cast<float>(value(x, y));
    return image;
}

// Normal deviates times `sigma`.
inline cv::Mat normal_noise(cv::Size size, double sigma, RandomStream& random) {
    return image_of(size, [&](int, int) { return sigma * random.normal(); });
}

}  // namespace etalon::test
