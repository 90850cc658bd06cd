// Focus distance and effective f-number from the blur along a tilted target.
//
// Thin lens (calib/camera/camera_model.h): a point at depth z (of a wide lens: its distance) has a
// blur disk of the radius R = fx (d/2) |1/z - 1/z_f| px, so over 1/z two straight lines meet at
// focus. Fitted to the pixels of all edges at once: aperture, 1/z_f and the width of the point
// spread at focus. With d = f/N, 1/f = 1/z_f + 1/v and v = fx * pixel pitch the aperture gives the
// engraved f-number N.
//
// Both sides of focus must be seen: from one side alone z_f, N and the width are told apart only by
// the assumed shapes of disk and point spread. Then the result says what is not determined; it is
// never guessed.
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>

#include "calib/camera/camera_model.h"
#include "compare/edges/edge_spread.h"

namespace etalon {

// What the point spread at focus is taken to be.
enum class FocusSpread {
    gaussian,     // sigma fitted, in place of the Airy pattern (psf: gaussian)
    diffraction,  // the Airy pattern of the f-number found, and nothing else (psf: ideal)
};

struct DefocusEstimate {
    bool is_determined = false;
    std::string undetermined;  // when not: what and why, in words; then the values below are 0
    double focus_distance_mm = 0.0, focus_distance_standard_uncertainty_mm = 0.0;
    double f_number = 0.0, f_number_standard_uncertainty = 0.0;
    double sigma_px = 0.0, sigma_standard_uncertainty_px = 0.0;  // FocusSpread::gaussian
    // Of (focus distance mm, f-number, sigma^2 px^2); without a sigma its row is zero.
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    // Pieces of edges nearer than focus and farther, whose blur disk is larger than 0.5 px.
    int edges_nearer = 0, edges_farther = 0;
    double largest_blur_px = 0.0;  // radius, over the pieces used
    // Pieces that were left out because their blur reaches the next edge (EdgeSelection's
    // clearance).
    int too_blurred = 0;
    double reduced_chi_square = 0.0;
    int edges = 0, pixels = 0, degrees_of_freedom = 0;  // edges: pieces of them
};

// Of the camera only intrinsics, pixel pitch and, for diffraction, the wavelength are used; its
// f-number, focus distance and point spread are not. Photographs at different settings of the lens
// must not be mixed. Throws NumericalError for a telecentric camera, without a pixel pitch (or
// wavelength), or with fewer than 12 edges. About 0.5 ms an edge. Safe from every thread.
DefocusEstimate estimate_defocus(std::span<const StraightEdge> edges, const CameraModel& camera,
                                 FocusSpread spread = FocusSpread::gaussian);

}  // namespace etalon
