// Markers and boards by name, as cell grids with the points that detectors report.
//
//   apriltag:36h11:5@50mm    black square 50 mm, one white cell around it; origin at its centre
//   aruco:4X4_50:7@50mm      the same for OpenCV's predefined dictionaries
//   stag:HD21:3@50mm         STag, a black square of 50 mm with a white border of an eighth of it;
//                            origin at its centre; stag:FILE.txt:3@50mm takes the codewords of a
//                            file (sim/marker/stag_pattern.h)
//   topotag:4x4:123@50mm     white square 50 mm, a black frame around it; 4x4-circle: round nodes;
//                            origin at its centre (sim/marker/topotag_pattern.h)
//   chessboard:9x6@25mm      9 x 6 INNER corners, squares of 25 mm; origin at the first inner
//                            corner, x along its row of 9, y along the other direction
//   charuco:4X4_50:9x6@30mm/22mm     9 x 6 SQUARES as OpenCV counts them, side of a square and of
//                            the ArUco markers in the white ones; charuco:4X4_50:9x6:20@30mm/22mm:
//                            the first marker has id 20
//   charuco-legacy:4X4_50:9x6@30mm/22mm     as OpenCV drew boards with an even number of rows
//                            before 4.6: the upper left square is white
//   aprilgrid:36h11:6x5@40mm/12mm    Kalibr's aprilgrid of 6 x 5 tags: side of a tag's black
//                            square (with its border of two cells) and of the gaps between
//   circles:7x6@20mm/12mm    spacing of the centres, diameter
//   acircles:4x11@20mm/12mm  the same in OpenCV's asymmetric layout: rows of 4, one spacing apart,
//                            every second one shifted by a spacing
//   hexcircles:28x24@12mm/10mm   every circle 12 mm from its six neighbours; columns and rows as
//                            BoofCV counts them: columns are half a spacing apart, and
//                            the lowest row begins in the first one
//   squares:4x3@30mm/20mm    4 x 3 black squares of 30 mm, 20 mm apart
//   bitmap:FILE@50x40mm      width x height; each pixel a cell, 0..255 (or 0..65535) -> radiance
//                            0..1 linear, colour as luma; origin at its centre
//
// An AprilTag's size is its reference square, whose corners the detector reports: for the classic
// families the black square; for Standard, Circle and Custom ones the smaller square between the
// white and the black ring, with data outside it (sim/marker/tag_pattern.h).
//
// A chessboard has (columns + 1) x (rows + 1) whole squares and a white margin of one square's
// width. The square above and left of the first inner corner is black, as in OpenCV's printed
// pattern. Where columns and rows are both even or both odd the board looks the same after half a
// turn: no detector can tell its two ends apart. All boards have their origin at the first of their
// points, which are listed row by row from the top left; how they are drawn:
// sim/marker/board_pattern.h.
//
// Marker frame: x right, y DOWN, z INTO the marker, as printed and seen from the front: a marker
// held upright before the camera has the identity rotation.
#pragma once

#include <Eigen/Core>
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
    // What a detector reports, in the marker frame: the four corners of a tag's reference square
    // from the top left clockwise as seen from the front; the vertices of a TopoTag row by row;
    // inner corners of a chessboard or ChArUco board, corners of a grid's tags or squares (2
    // columns x 2 rows) and centres of circles, row by row; none for a bitmap.
    std::vector<Eigen::Vector3d> points_mm;
    int columns = 0, rows = 0;  // of boards, as in the name
    double part_mm = 0;         // the second length of a board's name: marker, gap, diameter; or 0
    bool white_corner = false;  // of a ChArUco board: its upper left square is white
    double detail_mm = 0;       // the smallest length that a print must show; 0: a cell
};

// Throws ConfigError (with `place` as the file or option that held the name) for an unknown kind,
// family, dictionary or id, a tag that is its own half turn (ARUCO_ORIGINAL has one), a size that
// is not positive, or an unreadable bitmap. A bitmap's relative path is seen from the working
// directory. Safe from every thread; under a millisecond, some 10 ms for
// STag and boards of many cells.
Marker parse_marker(const std::string& spec, const std::string& place);

// The beginnings of such names: "apriltag", "chessboard", ...
std::vector<std::string> marker_kinds();

// The file that the marker's name names, as it stands there: a bitmap, or a table of STag's words;
// empty where the name says all.
std::string marker_file(const Marker& marker);

}  // namespace etalon
