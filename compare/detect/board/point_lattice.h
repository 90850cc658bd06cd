// Points of a photograph that stand in a lattice, and where a board lies in it.
//
// A lattice is grown from every point: two neighbours give the steps, each further point must be
// where the steps from its neighbours lead, and passes its own steps on, so that perspective and
// distortion may change them over the image. Which two directions were taken does not matter: the
// board is looked for under every change of basis with small whole numbers (determinant 1: boards
// are seen from the front) and every shift. So square, staggered and hexagonal boards are one case.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "compare/detect/board/dark_shapes.h"

namespace etalon {

struct LatticePoint {
    Eigen::Vector2i place;  // in steps; the second step is clockwise of the first as seen
    std::size_t point = 0;  // index of what was given
};
using PointLattice = std::vector<LatticePoint>;

// The largest lattices first, each of at least `min_points` points; every point is in one at most.
// Neighbours differ in area by less than half.
std::vector<PointLattice> find_lattices(const std::vector<DarkShape>& points,
                                        std::size_t min_points);

// Which point each place of the board is; nothing where it is hidden.
using BoardInLattice = std::vector<std::optional<std::size_t>>;

struct BoardMatch {
    // All ways in which the board covers the same places: two after half a turn, four of a square.
    std::vector<BoardInLattice> ways;
    std::string reason;  // why there are none, where a lattice was seen
};

// `board`: the places of a board's points in a lattice, in their order. At least three quarters of
// them must be seen, and no other place in the lattice may have as many.
BoardMatch match_board(const PointLattice& lattice, const std::vector<Eigen::Vector2i>& board);

// The shapes at the places of a board in a photograph (CV_8UC1), at the first scale that shows it.
struct FoundShapes {
    std::vector<std::optional<DarkShape>>
        shapes;          // in the board's order; empty where it is not seen
    std::string reason;  // why it is not
};
using FindShapes = std::vector<DarkShape> (*)(const cv::Mat& image, const ShapeScale& scale);
// Where nothing tells one end from the other, the first half of the board's places is the one
// nearer to the image's upper left.
FoundShapes find_board_of(FindShapes find, const cv::Mat& image,
                          const std::vector<Eigen::Vector2i>& board);

// A plane as it is seen around its points: px from mm by one homography, least squares over points,
// to place windows with. Distortion is left to who looks there.

struct SeenPlane {
    Eigen::Matrix3d pixel_from_mm;

    // Nothing when the points do not determine it.
    static std::optional<SeenPlane> through(const std::vector<Eigen::Vector2d>& mm,
                                            const std::vector<Eigen::Vector2d>& pixels);

    Eigen::Vector2d at(const Eigen::Vector2d& mm) const;
    Eigen::Matrix2d px_per_mm(const Eigen::Vector2d& mm) const;  // derivative
};

}  // namespace etalon
