// Discs in a grid of cells: what the patterns of round marks draw.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <opencv2/core.hpp>

namespace etalon {

// Fills the cells (CV_32FC1) whose centres are within `radius` of `centre`: both in cells, from the
// grid's top left corner. The disc must lie inside the grid.
inline void fill_disc(cv::Mat& cells, const Eigen::Vector2d& centre, double radius,
                      float radiance) {
    const auto first = [&](double middle) { return static_cast<int>(std::floor(middle - radius)); };
    for (int y = first(centre.y()); y < centre.y() + radius; ++y)
        for (int x = first(centre.x()); x < centre.x() + radius; ++x)
            if (std::hypot(x + 0.5 - centre.x(), y + 0.5 - centre.y()) <= radius)
                cells.at<float>(y, x) = radiance;
}

}  // namespace etalon
