// Markers and boards by name, as cell grids with the points that detectors report.
//
//   apriltag:36h11:5@50mm    black square 50 mm, one white cell around it; origin at its centre
//   aruco:4X4_50:7@50mm      the same for OpenCV's predefined dictionaries
//   chessboard:9x6@25mm      9 x 6 INNER corners, squares of 25 mm; origin at the first inner
//                            corner, x along its row of 9, y along the other direction
//   bitmap:FILE@50x40mm      width x height; each pixel a cell, 0..255 (or 0..65535) -> radiance
//                            0..1 linear, colour as luma; origin at its centre
//
// An AprilTag's size is its reference square, whose corners the detector reports: for the classic
// families the black square; for Standard, Circle and Custom ones the smaller square between the
// white and the black ring, with data outside it (sim/tag_pattern.h).
//
// A chessboard has (columns + 1) x (rows + 1) whole squares and a white margin of one square's
// width. The square above and left of the first inner corner is black, as in OpenCV's printed
// pattern. Where columns and rows are both even or both odd the board looks the same after half a
// turn: no detector can tell its two ends apart.
//
// Marker frame: x right, y DOWN, z INTO the marker, as printed and seen from the front: a marker
// held upright before the camera has the identity rotation.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "sim/cell_grid.h"

namespace etalon {

struct Marker {
    enum class Kind { apriltag, aruco, chessboard, bitmap };

    std::string spec;  // as given, for records
    Kind kind;
    std::string family;  // "36h11", "4X4_50"; empty for boards and bitmaps
    int id = 0;          // of tags
    double size_mm = 0;  // of the reference square, or of one chessboard square; 0 for bitmaps
    CellGrid grid;
    // What a detector reports, in the marker frame: the four corners of a tag's reference square
    // from the top left clockwise as seen from the front; a chessboard's inner corners, row by row;
    // none for a bitmap.
    std::vector<Eigen::Vector3d> points_mm;
    int columns = 0, rows = 0;  // of a chessboard's inner corners
};

// Throws ConfigError (with `place` as the file or option that held the name) for an unknown kind,
// family, dictionary or id, a tag that is its own half turn (ARUCO_ORIGINAL has one), a size that
// is not positive, or an unreadable bitmap. A bitmap's relative path is seen from the working
// directory. Safe from every thread; under a millisecond.
Marker parse_marker(const std::string& spec, const std::string& place);

}  // namespace etalon
