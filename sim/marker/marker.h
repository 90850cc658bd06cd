// Markers and boards by name, as cell grids with the points that detectors report. docs/files.md,
// "Markers", has the names.
//
// Single tags have a white border of one cell (STag: an eighth of its side), TopoTag one of black
// around its white square. An AprilTag's size is its reference square: of the classic families the
// black square, of Standard, Circle and Custom ones the smaller square between the white and the
// black ring, with data outside it. A chessboard has (columns + 1) x (rows + 1) whole squares and a
// white margin of one square's width; the square above and left of the first inner corner is black.
// Where columns and rows are both even or both odd it looks the same after half a turn.
//
// Marker frame: x right, y DOWN, z INTO the marker, as printed and seen from the front: a marker
// held upright before the camera has the identity rotation. The origin is the centre of a tag or
// bitmap, and the first of a board's points.
#pragma once

#include <string>
#include <vector>

#include "sim/marker/cell_grid.h"

namespace etalon {

struct Marker {
    enum class Kind {
        apriltag,
        aruco,
        topotag,
        chessboard,
        charuco,
        aprilgrid,
        circles,
        acircles,
        hexcircles,
        squares,
        bitmap,
        stag
    };

    std::string spec;  // as given, for records
    Kind kind;
    std::string family;  // "36h11", "4X4_50", or a file of codewords; empty without tags
    int id = 0;          // of single tags, and of a ChArUco board's first one
    double size_mm = 0;  // of the reference square, a board's square or tag, or the spacing of
                         // circles; 0 for bitmaps
    CellGrid grid;
    // What a detector reports: the four corners of a tag's reference square from the top left
    // clockwise; row by row the vertices of a TopoTag, inner corners of a chessboard or ChArUco
    // board, corners of a grid's tags or squares (2 columns x 2 rows), centres of circles; none for
    // a bitmap.
    std::vector<Eigen::Vector3d> points_mm;
    int columns = 0, rows = 0;  // of boards, as in the name
    double part_mm = 0;         // the second length of a board's name: marker, gap, diameter; or 0
    bool white_corner = false;  // of a ChArUco board: its upper left square is white
    double detail_mm = 0;       // the smallest length that a print must show; 0: a cell
};

// Throws ConfigError (with `place` as the file or option that held the name) for a name that has no
// marker, a tag that is its own half turn (ARUCO_ORIGINAL has one) and an unreadable bitmap. Safe
// from every thread; under a millisecond, some 10 ms for STag and boards of many cells.
Marker parse_marker(const std::string& spec, const std::string& place);

// The beginnings of such names: "apriltag", "chessboard", ...
std::vector<std::string> marker_kinds();

// The file that the marker's name names, as it stands there: a bitmap, or a table of STag's words;
// empty where the name says all.
std::string marker_file(const Marker& marker);

}  // namespace etalon
