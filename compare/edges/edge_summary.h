// What the edges of a photograph say together: how far the rendering's edges are off and where, of
// what parts the residual along them is, and how the blur changes with the depth. Edges with
// EdgeShift::is_beyond_range are counted and enter no other figure.
#pragma once

#include <optional>
#include <string>

#include "compare/edges/edge_shifts.h"
#include "compare/edges/edge_spread.h"

namespace etalon {

// RMS of the residual within the bands along the edges, and of its parts (EdgeShares), noise
// included: their squares, with the parts' signs, add up to the whole's.
struct EdgeParts {
    double shift_gray = 0.0, blur_gray = 0.0, photometric_gray = 0.0, rest_gray = 0.0;
    double residual_gray = 0.0;
};

struct ShiftSpread {
    // Without noise: the deviation that, together with each edge's own, explains the shifts (Paule
    // and Mandel, J. Res. NBS 87 (1982) 377, about zero). 0 where noise alone explains them.
    double rms_px = 0.0, rms_deviation_px = 0.0;  // the deviation for normal, independent shifts
    double with_noise_px = 0.0;                   // plain RMS of the shifts
    double noise_px = 0.0;                        // RMS of their stated deviations
};

struct EdgeSummary {
    int edges = 0, beyond_range = 0, pixels = 0;
    ShiftSpread shift;
    double median_shift_px = 0.0;  // 1.4826 times the median size, noise included: of most edges
    // Weighted means over all edges, and deviations from the scatter between them. A shift above 0:
    // dark parts are larger in the photograph.
    double mean_shift_px = 0.0, mean_shift_deviation_px = 0.0;
    double mean_blur_px2 = 0.0, mean_blur_deviation_px2 = 0.0;
    EdgeParts parts;
};

// Zero for no edges. A microsecond an edge.
EdgeSummary edge_summary(std::span<const EdgeShift> edges);

std::vector<EdgeShift> edges_of(std::span<const EdgeShift> edges, PixelUse use);

// The displacement of the photograph against the rendering in one part of the image.
struct ShiftVector {
    Eigen::Vector2d position_px = Eigen::Vector2d::Zero();  // mean of the edges' middles
    Eigen::Vector2d shift_px = Eigen::Vector2d::Zero();
    Eigen::Matrix2d covariance_px2 =
        Eigen::Matrix2d::Zero();  // by the edges' deviations or scatter
    int edges = 0;
};

// One vector for each square of `spacing_px` of the image that holds four edges or more, of
// directions that determine it; row by row. Throws NumericalError for sizes not above 0.
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

// Blur along a target that is tilted through focus, in photograph and rendering: edge_width() of
// compare/edges/edge_fit.h. A thin lens draws a point at depth z as a disk of variance
// (a fx (1/z - 1/z_f) / 2)^2, a the aperture's radius. Over 1/z the widths lie close to a parabola,
// lowest at the focus distance.

struct DepthBin {
    double low_mm = 0.0, high_mm = 0.0;
    int edges = 0;
    double depth_mm = 0.0;  // 1 / mean of 1/z
    // Variance along the normal, without the pixel: weighted mean over the edges.
    double measured_px2 = 0.0, measured_deviation_px2 = 0.0;
    double rendered_px2 = 0.0;
    double residual_rms_gray = 0.0;  // along the edges of edge_shifts() between these depths
};

struct WidthMinimum {
    bool is_determined = false;
    std::string undetermined;  // when not, why; then the values are 0
    double focus_distance_mm = 0.0, standard_uncertainty_mm = 0.0;
};

struct DefocusProfile {
    std::vector<DepthBin> bins;  // of equal ranges in 1/z, the nearest first; none without edges
    int edges = 0;               // measured in both images
    // Without noise the rendering's uncertainty says how well a parabola describes the widths.
    WidthMinimum photo, rendering;
};

// `rendering`: linear radiance, CV_32FC1, with the camera's blur, at this pose; `shifts`: the
// photograph's edges there, for the residuals. The clearance is to cover the widest blur disk.
// Throws NumericalError for a telecentric camera and for sizes that differ. A millisecond an edge.
// Safe from every thread.
DefocusProfile defocus_profile(const CodeImage& photo, const Radiance& rendering,
                               const Projector& projector, const CellGrid& grid,
                               const Rigid& camera_from_marker, const ComparedArea& area,
                               std::span<const EdgeShift> shifts,
                               const EdgeSelection& selection = {});

// Do the edges' shifts move with the board? What comes back at the same place of the board from
// other poses is the board's, not the camera's: not flat, or not printed true.

struct EdgesOfPhoto {
    std::vector<EdgeShift> edges;
    Rigid camera_from_marker;
};

// Of the displacements across each edge in the marker's plane, mm.
struct BoardShifts {
    double share = 0.0;  // of their mean square, the part that edges of different photographs share
    double rms_mm = 0.0;  // of that part
    // The share of changes of the photographs' signs after which as much is shared (wild bootstrap:
    // Wu, Ann. Statist. 14, 1986).
    double chance = 1.0;

    bool are_the_boards() const { return chance <= 0.01 && share >= 0.25; }
};

// Nothing for fewer than 8 photographs, and where none shares an edge with another. Perspective
// cameras. Milliseconds for a hundred edges in each of 20 photographs; safe from every thread.
std::optional<BoardShifts> board_shifts(std::span<const EdgesOfPhoto> photos,
                                        const Projector& projector, const ComparedArea& area);

}  // namespace etalon
