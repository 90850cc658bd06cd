// Grids of dark shapes on a brighter ground, dots or squares, and where a board lies in one.
//
// Shapes: the image is halved until little of it is left, and at each size compared with its local
// mean in two windows. An ellipse's outline has the same distance from the centre all around, by
// its own second moments. A square is four corners with straight sides between them.
//
// Lattices: one is grown from every shape. Two neighbours give the steps; each further shape must
// be where its neighbours' steps lead, and passes its own steps on. The board is looked for under
// every change of basis with small whole numbers (determinant 1: boards are seen from the front)
// and every shift, so that square, staggered and hexagonal boards are one case.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

namespace etalon {

struct DarkShape {
    Eigen::Vector2d centre;  // px
    double area_px2 = 0.0;
    std::vector<Eigen::Vector2d> corners = {};  // four of a square, clockwise as seen
};

enum class ShapeKind { ellipse, square };

// The shapes at the places of a board.
struct FoundShapes {
    // In the board's order; nothing where one is not seen, and empty where the board is not.
    std::vector<std::optional<DarkShape>> shapes;
    std::string reason;  // why it is not
};

// `board`: the places of a board's shapes in a lattice, in their order. At least three quarters of
// them must be seen, and no other place in the lattice may have as many. Where a half turn changes
// nothing, the first half of the places is nearer to the image's upper left. `image`: CV_8UC1. Safe
// from every thread.
FoundShapes find_shape_grid(ShapeKind kind, const cv::Mat& image,
                            const std::vector<Eigen::Vector2i>& board);

}  // namespace etalon
