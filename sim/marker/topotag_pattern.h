// The pattern of TopoTag markers: docs/topotag.md; G. Yu, Y. Hu, J. Dai, "TopoTag: A Robust and
// Scalable Topological Fiducial Marker System", IEEE Trans. Visualization and Computer Graphics
// 27(9), 2021.
//
// A white square of 4n + 1 cells a side holds n x n vertices, 4 cells apart, the first 2.5 cells
// from its edges, each in a black node of 3 x 3 cells whose middle cell is its bit. The second
// vertex of the first row lies 2 cells beside the first: both nodes are one, the baseline. The
// other n^2 - 2 bits, row by row, are the id, most significant first. Ours: the black frame of 2
// cells, a white cell around it, round nodes and dots (families "-circle").
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace etalon {

// "3x3", "4x4", "5x5", "6x6", and "3x3-circle" and so on.
const std::vector<std::string>& topotag_families();

// All below throw ConfigError for a name that is not among them.

// Ids run from 0; 2^(n^2 - 2) of them. Of 6x6 only those that an int holds, 2^31 - 1.
int topotag_count(const std::string& family);

int topotag_order(const std::string& family);  // n

// A square or a disk, in cells from the middle of the tag, x right, y down.
struct TopotagShape {
    Eigen::Vector2d centre = Eigen::Vector2d::Zero();
    double half_side = 0.0;  // or radius
    bool is_round = false;
    bool is_white = false;
};

// Everything that is to be painted on white paper, each over what came before: frame, white square,
// nodes in the order of their vertices, white dots. The id must be one of those.
std::vector<TopotagShape> topotag_shapes(const std::string& family, int id);

// The node and the dot of each vertex.
constexpr double topotag_node_half_side = 1.5, topotag_dot_half_side = 0.5;

// The vertices, row by row, in cells from the middle of the tag.
std::vector<Eigen::Vector2d> topotag_vertices(int order);

// Sides in cells.
constexpr int topotag_spacing = 4;
constexpr int topotag_white_side(int order) {
    return topotag_spacing * order + 1;
}
constexpr int topotag_frame = 2, topotag_margin = 1;

// With its white margin, CV_32FC1, 0 black, 1 white. Squares have one pixel a cell; round tags 28,
// disks centred exactly, areas those of diameters right to 3e-4. About 10 ms for round tags.
struct TopotagPattern {
    cv::Mat pixels;
    int pixels_per_cell = 1;
};
TopotagPattern topotag_pattern(const std::string& family, int id);

}  // namespace etalon
