// What the edges of a photograph say together: how far the rendering's edges are off, where, what
// the residual along them is made of, and how the blur changes with the depth.
//
// Edges beyond their range (EdgeShift::is_beyond_range) are counted and enter no other figure:
// where there are any, the RMS is that of the others, and too small.
#pragma once

#include <opencv2/core.hpp>

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/camera/projector.h"
#include "compare/edges/edge_shifts.h"
#include "compare/edges/edge_spread.h"
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

// Blur along a target that is tilted through focus: in the photograph and, as the camera's file has
// it, in the rendering.
//
// An edge's width is edge_width() (compare/edges/edge_fit.h), measured on both in the same way: the
// two can be compared however the blur is shaped and however far they are apart. A thin lens draws
// a point at depth z as a disk of radius R = a fx |1/z - 1/z_f| px, a the aperture's radius, of
// variance R^2 / 4: over inverse depth the widths lie close to a parabola, lowest in focus. Its
// place is the photograph's focus distance, whatever the camera's file says. Its height is only
// nearly right, as a disk is no Gaussian: compare/characterise/blur_estimate.h fits f-number and
// focus distance to the pixels.

// Edges between two depths.
struct DepthBin {
    double low_mm = 0.0, high_mm = 0.0;
    int edges = 0;
    double depth_mm = 0.0;  // 1 / mean of 1/z
    // Variance along the normal, without the pixel: mean over the edges weighted by their own
    // deviations; its deviation from these, or from the scatter among the edges where larger.
    double measured_px2 = 0.0, measured_deviation_px2 = 0.0;
    double rendered_px2 = 0.0;
    // Of the edges of edge_shifts() between these depths: RMS of the residual along them.
    double residual_rms_gray = 0.0;
};

// Where the widths are least.
struct WidthMinimum {
    bool is_determined = false;
    std::string undetermined;  // when not, why; then the values are 0
    double focus_distance_mm = 0.0, standard_uncertainty_mm = 0.0;
};

struct DefocusProfile {
    std::vector<DepthBin> bins;  // of equal ranges in 1/z, the nearest first; none without edges
    int edges = 0;               // measured in both images
    WidthMinimum photo;
    // Of the rendering: what the camera's file says, seen in the same way. It has no noise; its
    // uncertainty says how well a parabola describes the widths.
    WidthMinimum rendering;
};

// `rendering` is linear radiance, CV_32FC1, with the camera's blur, at this pose, and `shifts` are
// the edges of the same photograph at the same pose (for the residuals). `selection`'s clearance is
// to cover the widest blur disk. Throws NumericalError for a telecentric camera and for sizes
// that differ. A millisecond an edge. Safe from every thread.
DefocusProfile defocus_profile(const CodeImage& photo, const Radiance& rendering,
                               const Projector& projector, const Marker& marker,
                               const Rigid& camera_from_marker, const ComparedArea& area,
                               std::span<const EdgeShift> shifts,
                               const EdgeSelection& selection = {});

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
