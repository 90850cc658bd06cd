// Reads a STag codeword out of a quadrilateral, and tells whether it is a marker's own.
#pragma once

#include <opencv2/core.hpp>

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <optional>

#include "compare/detect/stag/stag_quads.h"
#include "sim/marker/stag_pattern.h"

namespace etalon {

// An image between its pixels.

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

// From the marker's plane, sides of its black square, origin at its centre, x right, y down, to
// homogeneous pixels.
using Homography = Eigen::Matrix3d;

// That takes the square's corners, from its top left clockwise, to these pixels. Nothing when three
// of them are on a line.
std::optional<Homography> homography_to(const Quad& corners);

// Largest over smallest depth of the square's corners, as far as the image shows it: 1 for a marker
// seen squarely. Not above 0 when a corner would be behind the camera.
double depth_ratio(const Homography& image_from_marker);

struct StagReading {
    StagCode code = 0;      // as seen: upright only if the first corner is the marker's top left
    double contrast = 0.0;  // mean white reference - mean black reference, in the image's values
};

// Samples the 48 code points and 12 black and 12 white references outside the circle, bilinearly,
// in a CV_32FC1 image, and cuts between black and white by Otsu's method. Nothing when a point is
// outside the image.
std::optional<StagReading> read_stag_code(const cv::Mat& image,
                                          const Homography& image_from_marker);

// How a reading differs from a marker's word: by so many discs, with the marker turned by so many
// quarters counter-clockwise. The least of the four.
struct StagMatch {
    int wrong_bits = 0;
    int quarters = 0;
};
StagMatch match_stag_code(StagCode seen, StagCode word);

}  // namespace etalon
