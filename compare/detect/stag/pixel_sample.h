// An image between its pixels.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

namespace etalon {

// The bilinear value of a CV_32FC1 image; nothing outside the pixels' centres and for a place that
// is not finite.
inline std::optional<double> bilinear(const cv::Mat& image, const Eigen::Vector2d& place) {
    if (!(place.x() >= 0.0 && place.y() >= 0.0 && place.x() < image.cols - 1 &&
          place.y() < image.rows - 1))
        return std::nullopt;
    const int x = static_cast<int>(place.x()), y = static_cast<int>(place.y());
    const double right = place.x() - x, down = place.y() - y;
    const float* upper = image.ptr<float>(y) + x;
    const float* lower = image.ptr<float>(y + 1) + x;
    return (1.0 - down) * ((1.0 - right) * upper[0] + right * upper[1]) +
           down * ((1.0 - right) * lower[0] + right * lower[1]);
}

}  // namespace etalon
