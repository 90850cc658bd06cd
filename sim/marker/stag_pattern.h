// How a STag marker looks: a black square with a white disk in it, and in the disk 48 small discs,
// black or white, that hold the codeword (sim/marker/stag_codes.h).
//
// Geometry of the publication and of the authors' generator, in units of the black square's side:
// white border 0.125, radius of the disk 0.4, code in the radius 0.35, radius of a code disc
// 0.0437. Black discs next to each other are joined by a smaller one half way, so that no thin
// white lines are left between them; the generator also rounds the joined outline off (a majority
// filter on its bitmap), which is not done here. A detector sees the same code points.
#pragma once

#include <Eigen/Core>
#include <array>
#include <opencv2/core.hpp>

#include "sim/marker/stag_codes.h"

namespace etalon {

inline constexpr double stag_border = 0.125, stag_circle_radius = 0.4;

// The centres of the code discs in a marker of side 1: origin at its centre, x right, y down. A
// quadrant has 12, the first one is the upper right, the others follow counter-clockwise: point
// i + 12 is point i turned by a quarter about the centre.
const std::array<Eigen::Vector2d, stag_bits>& stag_code_points();

inline constexpr double stag_detail = 0.02;    // what a print must show of rounded outlines
inline constexpr int stag_cells_a_side = 320;  // of the black square

// The marker with its white border, CV_32FC1, 0 black, 1 white, from the top left. A disc is the
// cells whose centres are inside it: a staircase, symmetric about the marker's centre for the large
// disk, whose area is right to 2e-4.
cv::Mat stag_cells(StagCode code);

}  // namespace etalon
