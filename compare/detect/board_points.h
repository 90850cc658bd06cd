// The points of boards with tags and of circle grids in a photograph, to sub-pixel, each with its
// index on the board: what compare/detect/calibration_target.h puts together. Corners are refined
// by compare/detect/saddle_point.h in windows that hold no other edge.
//
// All take an image as CV_32FC1 with full scale 1 beside its 8-bit form, return points in the order
// of their indices, none where the board is not seen, and are safe from every thread.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "sim/marker/marker.h"

namespace etalon {

struct BoardPoint {
    int id;  // index into Marker::points_mm
    Eigen::Vector2d pixel;
};

struct BoardPhoto {
    cv::Mat pixels;     // CV_32FC1, full scale 1
    cv::Mat eight_bit;  // CV_8UC1, what the libraries expect
};

// Inner corners beside at least one marker that was read. compare/detect/charuco_corners.cpp
std::vector<BoardPoint> find_charuco_corners(const Marker& board, const BoardPhoto& photo);

// Corners of the tags that were read. Blur and dark squares that touch at their corners would join
// tags to one outline: they are looked for in copies with dark parts shrunk by one and two pixels,
// too. compare/detect/tag_grid_corners.cpp
std::vector<BoardPoint> find_tag_grid_corners(const Marker& board, const BoardPhoto& photo);

// Centroids of the circles' images, all or none: of 1 - brightness / background, with the
// background a plane through what is seen halfway to the neighbours. A circle's centre is NOT seen
// at its image's centroid; compare/detect/calibration_target.h corrects for that.
// compare/detect/circle_grid.cpp
std::vector<BoardPoint> find_circle_centroids(const Marker& board, const BoardPhoto& photo);

}  // namespace etalon
