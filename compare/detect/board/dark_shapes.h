// Dark shapes on a brighter ground, each on its own: the dots and squares of printed grids.
//
// The image is halved until little of it is left, and at each size compared with its local mean in
// two windows, which takes uneven light off. The outline of what is darker tells the shape. Of an
// ellipse its distance from the centre, measured by the outline's own second moments, is the same
// all around: squares, letters and merged dots are none. A square is seen as four corners with
// straight sides between them.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace etalon {

struct DarkShape {
    Eigen::Vector2d centre;  // px
    double area_px2 = 0.0;
    std::vector<Eigen::Vector2d> corners = {};  // four of a square, clockwise as seen
};

// What one window at one size sees.
struct ShapeScale {
    int halvings, window;
};

// From the coarsest, which is the cheapest, to the finest, which sees dots of 5 px. Those of 200 px
// are seen at the third halving of an image that has 1000 px.
std::vector<ShapeScale> shape_scales(cv::Size image_size);

// In an image CV_8UC1. Safe from every thread; about 10 ns a pixel of the halved image.
std::vector<DarkShape> find_dark_ellipses(const cv::Mat& image, const ShapeScale& scale);
std::vector<DarkShape> find_dark_squares(const cv::Mat& image, const ShapeScale& scale);

}  // namespace etalon
