// What differs between a photograph and its rendering along each of the marker's edges: the edge's
// place (to a hundredth of a pixel), its blur, the levels at both sides, and the rest.
//
// The marker is rendered at five places a fraction of a pixel apart. Pixel by pixel their quartic
// interpolant R(s) is the radiance with the edge displaced by s along its normal. Each edge of the
// photograph is fitted with
//     gray = G(R(s) + v/2 R''(s) + v^2/8 R''''(s)) + (1 - t) b + t w
// by weighted least squares in s, v, b and w. G is the photometric model of this photograph, t its
// light part (0 on the dark side, 1 on the light one), v the blur's variance. Behind a Gaussian of
// 0.5 px shifts up to 0.5 px are right to 0.001 px, blur up to a third of the edge's own variance
// to 3 %.
#pragma once

#include "compare/photometric/compared_area.h"
#include "compare/photometric/photometric_equations.h"

namespace etalon {

// The residual photograph - prediction (gray) in an edge's band, in parts that add up to it. A
// share is the sum over the pixels of part * residual, negative where its part cancels another.
// Noise adds its variance to the shares of shift and blur, and twice that to the levels'.
struct EdgeShares {
    double shift = 0.0, blur = 0.0, photometric = 0.0, rest = 0.0;  // gray^2
    double total() const { return shift + blur + photometric + rest; }
};

// One straight piece of an edge between a darker and a lighter cell.
struct EdgeShift {
    Eigen::Vector2d middle_px = Eigen::Vector2d::Zero();
    Eigen::Vector2d normal = Eigen::Vector2d::UnitX();  // in the image, from dark to light
    double length_px = 0.0;                             // of the band along the edge
    double half_width_px = 0.0;                         // of the band to either side
    double depth_mm = 0.0;                              // z of its middle, camera frame
    double radius_px = 0.0;                             // from the image's centre
    PixelUse use = pixel_outside;                       // of most of its pixels
    int pixels = 0;

    // Photograph minus rendering, with standard deviations: place and blur along the normal, levels
    // at both sides.
    double shift_px = 0.0, shift_deviation_px = 0.0;
    double blur_variance_px2 = 0.0, blur_deviation_px2 = 0.0;
    double black_gray = 0.0, black_deviation_gray = 0.0;
    double white_gray = 0.0, white_deviation_gray = 0.0;
    double step_gray = 0.0;  // the fitted height: white - black
    // Beyond the rendered places: shift_px is the end of their range, some 0.6 px, and no other
    // figure of this edge is valid.
    bool is_beyond_range = false;
    // Over the noise; in gray^2 where the camera knows no noise. The deviations are multiplied by
    // its root where that is above 1 or the noise is not known. Pixels count as independent.
    double reduced_chi_square = 0.0;
    // Of the rendered edge: second moment of its spread within the band, pixel included.
    double rendered_variance_px2 = 0.0;
    EdgeShares shares;  // sums over the pixels
};

// The edges of the marker in a photograph that `state` says it matches. Pixels count where
// photo.use is not 0. An edge's band ends halfway to the next edge and keeps clear of crossings by
// about the blur's reach. Pieces are one cell's side long at most, or 12 px where cells are
// smaller. Left out are pieces with less than 3 px between crossings, cells under 4 px across,
// under 16 pixels in the compared area or no contrast, or that do not determine the four unknowns.
// Perspective cameras. Throws NumericalError for sizes that differ, what is not finite, and what
// the renderer refuses. Five renderings, and some 30 us an edge. Safe from every thread.
std::vector<EdgeShift> edge_shifts(const PhotoOfMarker& photo, const PhotometricCamera& camera,
                                   const PhotoState& state);

}  // namespace etalon
