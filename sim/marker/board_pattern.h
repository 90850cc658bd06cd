// The cells and points of calibration boards. All throw ConfigError (without a place) for a board
// whose lengths would need more than 16 million cells, circles more than 4 million.
//
// Squares, tags and circles lie exactly where they should, although lengths need have no common
// measure; only edges inside a tag are rounded, to a twentieth of its cell. A circle is the cells
// whose centres are inside: 128 to a diameter (24 at least, on large boards), centre exact, the
// diameter of the same area right to 2e-3.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "sim/marker/cell_grid.h"

namespace etalon {

// In the board's frame: x right, y down, the origin at the first point.
struct BoardPattern {
    CellGrid grid;                           // with a white margin
    std::vector<Eigen::Vector3d> points_mm;  // row by row from the top left
    double detail_mm = 0.0;                  // the smallest length that a print must show
};

// A tag on a board: the corners of its black square, from the top left clockwise.
struct BoardTag {
    int id;
    std::array<Eigen::Vector2d, 4> corners_mm;
};

// columns x rows INNER corners; (columns + 1) x (rows + 1) squares, the upper left one black.
BoardPattern chessboard_pattern(int columns, int rows, double square_mm);

// columns x rows SQUARES; ArUco markers in the white squares, numbered row by row from the first
// one's id. The upper left square is black or white. The points are the inner corners.
struct CharucoLayout {
    int first_id = 0;
    bool white_corner = false;
};
BoardPattern charuco_pattern(const std::string& dictionary, int columns, int rows, double square_mm,
                             double marker_mm, const CharucoLayout& layout);
std::vector<BoardTag> charuco_tags(int columns, int rows, double square_mm, double marker_mm,
                                   const CharucoLayout& layout);

// Kalibr's aprilgrid: columns x rows tags with a black border of TWO cells, numbered row by row
// from the BOTTOM left, a black square in every crossing of the gaps; points: the tags' corners, 2
// columns x 2 rows. Throws ConfigError for families with data outside the reported square.
BoardPattern aprilgrid_pattern(const std::string& family, int columns, int rows, double tag_mm,
                               double gap_mm);
std::vector<BoardTag> aprilgrid_tags(int columns, int rows, double tag_mm, double gap_mm);

// Black circles; the points are the centres. Asymmetric as in OpenCV's samples: circles of a row
// are 2 spacings apart and rows one. Hexagonal as BoofCV counts it: columns are half a spacing
// apart, and a row has circles in every second of them, the lowest row from the first one on.
enum class CircleLayout { symmetric, asymmetric, hexagonal };
BoardPattern circles_pattern(CircleLayout layout, int columns, int rows, double spacing_mm,
                             double diameter_mm);
double nearest_circle_mm(CircleLayout layout, double spacing_mm);  // between neighbours' centres
// The column (in half steps where rows are staggered) and the row of each circle.
std::vector<Eigen::Vector2i> circle_places(CircleLayout layout, int columns, int rows);

// columns x rows black squares, a gap apart; the points are their corners, as a grid of 2 columns x
// 2 rows.
BoardPattern squares_pattern(int columns, int rows, double square_mm, double gap_mm);

}  // namespace etalon
