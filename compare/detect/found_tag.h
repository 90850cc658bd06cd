// A square fiducial tag that a library found, in our pixel convention: what the detectors of single
// tags and those of boards share.
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "compare/detect/detector_adaptors.h"

namespace etalon {

struct FoundTag {
    int id = 0;
    std::array<Eigen::Vector2d, 4> corners;  // of the black square, from the top left clockwise
};

// What is taken off the coordinates that OpenCV gives: contour and sub-pixel corners count from the
// first pixel's centre, as ours do. The AprilTag quads count from its corner, and OpenCV hands them
// on unchanged.
double library_offset_px_of(ArucoRefinement refinement);

// OpenCV's ArUco on an 8-bit image, all ids of a dictionary of sim/marker/tag_pattern.h. What
// sub-pixel refinement there is, is the library's: with ArucoRefinement::subpixel the corners are
// unrefined.
std::vector<FoundTag> find_aruco_tags(const cv::Mat& image, const std::string& dictionary,
                                      ArucoRefinement refinement);

}  // namespace etalon
