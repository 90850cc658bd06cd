// The points of boards with tags and of circle grids in a photograph, to sub-pixel, each with its
// index on the board: what compare/detect/board/calibration_target.h puts together. Corners are
// refined by compare/detect/board/saddle_point.h in windows that hold no other edge.
//
// All take an image as CV_32FC1 with full scale 1 beside its 8-bit form, return points in the order
// of their indices, none where the board is not seen, and are safe from every thread.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "sim/marker/marker.h"

namespace etalon {

struct BoardPoint {
    int id;  // index into Marker::points_mm
    Eigen::Vector2d pixel;
};

struct FoundBoard {
    std::vector<BoardPoint> points = {};
    std::string reason = {};  // why there are none, where something of the board is seen
    // The name of the board that is seen, where that is another than the one looked for, with its
    // points in the same places.
    std::string shown_as = {};
};

struct BoardPhoto {
    cv::Mat pixels;     // CV_32FC1, full scale 1
    cv::Mat eight_bit;  // CV_8UC1, what the libraries expect
};

// Inner corners beside at least one marker that was read, in whichever of the two layouts the
// markers agree with. compare/detect/board/charuco_corners.cpp
FoundBoard find_charuco_corners(const Marker& board, const BoardPhoto& photo);

// Corners of the tags that were read. Blur and dark squares that touch at their corners would join
// tags to one outline: they are looked for in copies with dark parts shrunk by one and two pixels,
// too. compare/detect/board/tag_grid_corners.cpp
FoundBoard find_tag_grid_corners(const Marker& board, const BoardPhoto& photo);

// Centroids of the circles' images; a quarter of them may be hidden. Of 1 - brightness /
// background, with the background a plane through what is seen halfway to the neighbours. A
// circle's centre is NOT seen at its image's centroid; compare/detect/board/calibration_target.h
// corrects for that. compare/detect/board/circle_grid.cpp
FoundBoard find_circle_centroids(const Marker& board, const BoardPhoto& photo);

// Corners of dark squares on their own; a quarter of the squares may be hidden.
// compare/detect/board/square_grid.cpp
FoundBoard find_square_corners(const Marker& board, const BoardPhoto& photo);

}  // namespace etalon
