// A planar pattern as a grid of rectangular cells of constant radiance: the only geometry that the
// renderer draws. Tags, chessboards and bitmaps are all made of it.
#pragma once

#include <opencv2/core.hpp>

#include <Eigen/Core>
#include <cmath>

namespace etalon {

inline constexpr float black = 0.0f, white = 1.0f;  // of a printed cell

struct CellGrid {
    cv::Mat cells;  // CV_32FC1, rows x columns, linear radiance 0..1, row 0 on top
    // Marker-frame position of the grid's top-left corner.
    Eigen::Vector2d corner_mm = Eigen::Vector2d::Zero();
    Eigen::Vector2d cell_mm = Eigen::Vector2d::Zero();  // size along x and y

    int rows() const { return cells.rows; }
    int columns() const { return cells.cols; }

    // Marker-frame point of grid coordinates (u along x, v along y, in cells from the corner).
    Eigen::Vector3d point_mm(double u, double v) const {
        return {corner_mm.x() + u * cell_mm.x(), corner_mm.y() + v * cell_mm.y(), 0.0};
    }
};

// Discs in a grid of cells: what the patterns of round marks draw.

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
