// What the edges of a photograph say together: how far the rendering's edges are off, where, and
// what the residual along them is made of.
//
// Edges beyond their range (EdgeShift::is_beyond_range) are counted and enter no other figure:
// where there are any, the RMS is that of the others, and too small.
#pragma once

#include <opencv2/core.hpp>

#include <optional>
#include <span>
#include <vector>

#include "calib/camera/projector.h"
#include "compare/edges/edge_shifts.h"
#include "compare/photometric/compared_area.h"
#include "core/geometry/rigid.h"

namespace etalon {

// RMS of the residual within the bands along the edges, gray, and of its parts: their squares add
// up to the whole's, with their signs (a part is negative where it cancels some of the others: see
// EdgeShares). Noise is in all of them.
struct EdgeParts {
    double shift_gray = 0.0, blur_gray = 0.0, photometric_gray = 0.0, rest_gray = 0.0;
    double residual_gray = 0.0;
};

// A spread of which the noise is taken out: the deviation that, together with each edge's own,
// explains the shifts (Paule and Mandel, J. Res. NBS 87 (1982) 377, about zero). 0 where noise
// alone explains them.
struct ShiftSpread {
    double rms_px = 0.0;
    double rms_deviation_px = 0.0;  // taking the shifts for normal and independent of each other
    double with_noise_px = 0.0;     // plain RMS of the shifts
    double noise_px = 0.0;          // RMS of their stated deviations
};

struct EdgeSummary {
    int edges = 0, beyond_range = 0, pixels = 0;
    ShiftSpread shift;
    double median_shift_px = 0.0;  // 1.4826 times the median size, noise included: of most edges
    // Weighted means over all edges. Of the shift: above 0 where dark parts are larger in the
    // photograph. The deviations count the scatter between the edges.
    double mean_shift_px = 0.0, mean_shift_deviation_px = 0.0;
    double mean_blur_px2 = 0.0, mean_blur_deviation_px2 = 0.0;
    double median_chi_square = 0.0;  // of EdgeShift::reduced_chi_square
    EdgeParts parts;
};

// Zero for no edges. A microsecond an edge.
EdgeSummary edge_summary(std::span<const EdgeShift> edges);

// The edges of one half of the marker's cells.
std::vector<EdgeShift> edges_of(std::span<const EdgeShift> edges, PixelUse use);

// The displacement of the photograph against the rendering in one part of the image: an edge shows
// only what is along its normal, edges of several directions show both.
struct ShiftVector {
    Eigen::Vector2d position_px = Eigen::Vector2d::Zero();  // mean of the edges' middles
    Eigen::Vector2d shift_px = Eigen::Vector2d::Zero();
    // From the edges' deviations, and the scatter about the vector where that is larger.
    Eigen::Matrix2d covariance_px2 = Eigen::Matrix2d::Zero();
    int edges = 0;
};

// One vector for each square of `spacing_px` of the image that holds four edges or more, of
// directions that determine it; row by row. Throws NumericalError for a spacing or size not above
// 0.
std::vector<ShiftVector> shift_field(std::span<const EdgeShift> edges, cv::Size image,
                                     double spacing_px);

// Edges within a range of image radius (px) or depth (mm).
struct EdgeBin {
    double low = 0.0, high = 0.0;
    EdgeSummary summary;
};

// From the image's centre to its corner, and from the nearest edge to the farthest: equal ranges,
// low <= value < high, the last range's end included. Throws NumericalError for no bins. Empty for
// no edges.
std::vector<EdgeBin> edges_by_radius(std::span<const EdgeShift> edges, cv::Size image, int bins);
std::vector<EdgeBin> edges_by_depth(std::span<const EdgeShift> edges, int bins);

// Do the edges' shifts move with the board? What comes back at the same place of the board in
// photographs from other poses is the board's: it is not flat, or not printed true. What stays in
// the image is the camera's, and differs from photograph to photograph on the board.

struct EdgesOfPhoto {
    std::vector<EdgeShift> edges;
    Rigid camera_from_marker;
};

// Of the displacements across each edge in the marker's plane, mm.
struct BoardShifts {
    double share = 0.0;  // of their mean square, the part that edges of different photographs share
    double rms_mm = 0.0;  // of that part
    // Errors of a photograph could as well have the other sign, all of them together: the share of
    // such changes of sign after which as much is shared (the wild bootstrap: Wu, Ann. Statist. 14,
    // 1986).
    double chance = 1.0;

    bool are_the_boards() const { return chance <= 0.01 && share >= 0.25; }
};

inline constexpr std::size_t min_board_photos = 8;  // 2^7 signs: a chance of 1/128 can be seen

// Nothing for fewer photographs, and where none shares an edge with another. Perspective cameras.
// Milliseconds for a hundred edges in each of 20 photographs; safe from every thread.
std::optional<BoardShifts> board_shifts(std::span<const EdgesOfPhoto> photos,
                                        const Projector& projector, const ComparedArea& area);

}  // namespace etalon
