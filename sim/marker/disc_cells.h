// Discs in a grid of cells: what the patterns of round marks draw.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <opencv2/core.hpp>

namespace etalon {

// Fills the cells (CV_32FC1) whose centres are within a disc: its centre from the grid's top left
// corner and its radius, both in cells along x and along y. The disc must lie inside the grid.
inline void fill_disc(cv::Mat& cells, const Eigen::Vector2d& centre, const Eigen::Vector2d& radius,
                      float radiance) {
    const Eigen::Vector2d low = centre - radius, high = centre + radius;
    for (int y = static_cast<int>(std::floor(low.y())); y < high.y(); ++y)
        for (int x = static_cast<int>(std::floor(low.x())); x < high.x(); ++x)
            if (std::hypot((x + 0.5 - centre.x()) / radius.x(),
                           (y + 0.5 - centre.y()) / radius.y()) <= 1.0)
                cells.at<float>(y, x) = radiance;
}

}  // namespace etalon
