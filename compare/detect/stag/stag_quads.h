// Dark quadrilaterals in an image: the first step of finding STag markers, from edge segments as in
// the publication (sim/marker/stag_pattern.h).
//
// Edge segments are chains of pixels along which the gradient is largest (Edge Drawing, parameter
// free: C. Akinlar, C. Topal, "EDPF", IJPRAI 26, 2012; OpenCV's implementation). A chain is cut
// into straight lines; four lines in a row of which each meets the next make a quadrilateral, whose
// fourth corner is where the last line meets the first: a corner may be hidden.
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core.hpp>
#include <vector>

namespace etalon {

// In our pixels, clockwise as seen in the image, beginning anywhere.
using Quad = std::array<Eigen::Vector2d, 4>;

// `image` is CV_8UC1. Corners are good to a pixel or two. Convex quadrilaterals only; many are no
// markers, and one may be found more than once. Safe from every thread; about 2 ms for 640x480.
std::vector<Quad> find_quads(const cv::Mat& image);

}  // namespace etalon
