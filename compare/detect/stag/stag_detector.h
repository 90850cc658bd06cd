// STag markers (sim/marker/stag_pattern.h): quadrilaterals, their codewords, and the corners from
// all edges. Method and figures: docs/stag.md. All functions are safe from every thread.
#pragma once

#include <memory>
#include <span>

#include "compare/detect/detector.h"
#include "sim/marker/stag_pattern.h"

namespace etalon {

// Corners in our pixels, clockwise as seen in the image.
using Quad = std::array<Eigen::Vector2d, 4>;

// Of a CV_32FC1 image; nothing outside the pixels' centres and for a place that is not finite.
std::optional<double> bilinear(const cv::Mat& image, const Eigen::Vector2d& place);

// From the marker's plane, sides of its black square, origin at its centre, x right, y down, to
// homogeneous pixels.
using Homography = Eigen::Matrix3d;

// That takes the square's corners, from its top left clockwise, to these pixels; 1 is its last
// number. Nothing when three of them are on a line.
std::optional<Homography> homography_to(const Quad& corners);

// The corners from all edges, from the marker's top left clockwise. Sides and circle are measured
// edge by edge along their normals, by the area under the gray profile, which no symmetric blur
// displaces. A joint least-squares fit with Tukey's weights finds the homography, radial
// distortion, and by how much all edges are displaced towards the light.
//
// `start` has the marker upright, with corners good to two pixels or so; `code` is its word,
// `contrast` that of its references in `image` (CV_32FC1). Nothing when the edges do not fix every
// corner to 0.25 px, or do not fit one view. About 0.3 ms.
std::optional<Quad> refine_stag(const cv::Mat& image, const Homography& start, StagCode code,
                                double contrast);

// Unrefined corners are where the edge segments' lines meet: no measurement, good to a pixel or so.
struct FoundStag {
    int id = 0;    // place among the words
    Quad corners;  // of the black square, from its top left clockwise
    bool is_refined = false;
};

// All places where a marker with one of these words is seen, with at most so many of its 48 discs
// misread; of those that overlap the one with the fewest. 3 ms for 640x480.
std::vector<FoundStag> find_stags(const CodeImage& image, std::span<const StagCode> words,
                                  int correctable_bits);

// Reports refined corners only: a marker that is too small or too hidden for that is not found.
std::unique_ptr<Detector> make_stag_detector(const Marker& marker);

}  // namespace etalon
