// Our finder of STag markers (sim/marker/stag_pattern.h): quadrilaterals, their codewords, and the
// corners from all edges. Method and figures: docs/stag.md. All functions are safe from every
// thread.
#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <vector>

#include "compare/detect/detector.h"
#include "core/image/image.h"
#include "sim/marker/stag_pattern.h"

namespace etalon {

// Corners in our pixels, clockwise as seen in the image.
using Quad = std::array<Eigen::Vector2d, 4>;

// The bilinear value of a CV_32FC1 image; nothing outside the pixels' centres and for a place that
// is not finite.
std::optional<double> bilinear(const cv::Mat& image, const Eigen::Vector2d& place);

// From the marker's plane, sides of its black square, origin at its centre, x right, y down, to
// homogeneous pixels.
using Homography = Eigen::Matrix3d;

// That takes the square's corners, from its top left clockwise, to these pixels; 1 is its last
// number. Nothing when three of them are on a line.
std::optional<Homography> homography_to(const Quad& corners);

struct StagRefinement {
    Quad corners;                // from the marker's top left clockwise
    double edge_shift_px = 0.0;  // of all edges towards the light
    double rms_px = 0.0;         // of the edges' distances from the fit
    double sigma_px = 0.0;       // standard deviation of the worst corner's coordinate, from that
};

// The corners from all edges: where the four sides and the circle are, to a small part of a pixel,
// and the one view of the marker that fits them best. The publication fits the circle alone, on
// whole edge pixels, and does nothing where it is not found as one closed segment. Here every edge
// is measured on its own along its normal, by the area under the gray profile, which no symmetric
// blur displaces. A joint least-squares fit with Tukey's weights finds the homography, radial
// distortion, and by how much all edges are displaced.
//
// `start` has the marker upright, with corners good to two pixels or so; `code` is its word, and
// `contrast` that of its references in `image` (CV_32FC1). Nothing when the edges that are found do
// not fix every corner to a quarter of a pixel (small or hidden markers), or do not fit one view.
// About 0.3 ms.
std::optional<StagRefinement> refine_stag(const cv::Mat& image, const Homography& start,
                                          StagCode code, double contrast);

// Unrefined corners are where the edge segments' lines meet, good to a pixel or so, and now and
// then several pixels wrong: a sign of the marker, no measurement.
struct FoundStag {
    int id = 0;          // place among the words
    Quad corners;        // of the black square, from its top left clockwise
    int wrong_bits = 0;  // that were corrected
    bool is_refined = false;
};

// All places where a marker with one of these words is seen, with at most so many of its 48 discs
// misread; of those that overlap the one with the fewest. A refined place has been read again with
// its refined corners. 3 ms for 640x480.
std::vector<FoundStag> find_stags(const CodeImage& image, std::span<const StagCode> words,
                                  int correctable_bits);

// Reports refined corners only: a marker that is too small or too hidden for that is not found.
std::unique_ptr<Detector> make_stag_detector(const Marker& marker);

}  // namespace etalon
