// The blur of a lens from the edges of a known target: how the lens spreads a point, and how the
// blur grows away from focus. Fitted to the pixels of all edges at once (compare/edges/edge_fit.h).
#pragma once

#include <array>
#include <optional>
#include <string>

#include "compare/edges/edge_spread.h"

namespace etalon {

// Point spread: what `lens: psf` of the camera file holds. A Gaussian in place of the Airy pattern
// (psf: gaussian), without the defocus that the lens section states; or any round pattern whose
// density does not rise outwards (psf: measured), defocus included: non-negative weights of disks
// with sloping rims. An overshoot is sharpening in the camera or a wrong transfer curve: sigma and
// profile then describe no lens and are not to be written into a camera file.

// A Gaussian's width, of the edges in one zone or of all. Uncertainty: EdgeFit::covariance.
struct BlurWidth {
    double sigma_px = 0.0, standard_uncertainty_px = 0.0;
    double residual_rms = 0.0;  // in parts of the edges' contrast
    int edges = 0;
};

// One bin of the mean profile: parts of the contrast, 0 on the dark side, 1 on the light one.
struct EdgeSpreadRow {
    double distance_px, value, standard_uncertainty;
    int pixels;
};

inline constexpr double min_overshoot = 0.01;  // of the contrast: less is not called sharpening

struct Sharpening {
    // Largest mean over 0.5 px of the profile above the light side's level (below the dark side's),
    // in parts of the contrast, 0.5 to 4 px from the edge; negative: none.
    double overshoot = 0.0, overshoot_standard_uncertainty = 0.0, undershoot = 0.0;
    bool is_detected = false;  // one is above min_overshoot by over 4 standard uncertainties
};

struct ProfileRow {
    double radius_px, density, standard_uncertainty;  // energy per px^2; the whole is 1
};

struct MeasuredSpread {
    std::vector<ProfileRow> rows;  // as `psf: measured` holds it
    Eigen::MatrixXd covariance;    // of the densities
    double residual_rms = 0.0;     // as BlurWidth's

    // At a frequency along x, pixel box not included, and its standard uncertainty.
    std::pair<double, double> modulation(double cycles_per_px) const;
};

// Which of 3 x 3 zones of the image a pixel is in, row by row.
std::size_t image_zone(const CameraModel& camera, const Eigen::Vector2d& pixel);

struct PointSpreadEstimate {
    BlurWidth gaussian;  // of all edges
    // By image_zone(); nothing where a zone has fewer than 4 edges.
    std::array<std::optional<BlurWidth>, 9> zones;
    std::optional<MeasuredSpread> measured;  // nothing: too few edges for a profile (below 8)
    // An F test of the measured pattern against the Gaussian, at 0.1 %: which of them to write.
    bool gaussian_suffices = true;
    std::vector<EdgeSpreadRow> edge_spread;
    Sharpening sharpening;
};

// These two alone, edges and errors as below. Sharpening may have edges with clipped pixels
// (EdgeSelection::with_clipped).
Sharpening measure_sharpening(std::span<const StraightEdge> edges, const CameraModel& camera);
BlurWidth estimate_gaussian(std::span<const StraightEdge> edges, const CameraModel& camera);

// Edges of one or several photographs (all with one camera). Throws NumericalError for fewer than 4
// edges and when a fit does not converge. About 0.1 ms an edge for a width, ten times that for the
// profile. Safe from every thread.
PointSpreadEstimate estimate_point_spread(std::span<const StraightEdge> edges,
                                          const CameraModel& camera);

// Focus distance and effective f-number from the blur along a tilted target.
//
// Thin lens (calib/camera/camera_model.h): a point at depth z (of a wide lens: its distance) has a
// blur disk of the radius R = fx (d/2) |1/z - 1/z_f| px. Fitted are aperture d, 1/z_f and the width
// of a Gaussian point spread at focus. With d = f/N, 1/f = 1/z_f + 1/v and v = fx * pixel pitch the
// aperture gives the engraved f-number N. Both sides of focus must be seen.
struct DefocusEstimate {
    bool is_determined = false;
    std::string undetermined;  // when not: what and why, in words; then the values below are 0
    double focus_distance_mm = 0.0, focus_distance_standard_uncertainty_mm = 0.0;
    double f_number = 0.0, f_number_standard_uncertainty = 0.0;
    double sigma_px = 0.0, sigma_standard_uncertainty_px = 0.0;  // of the point spread at focus
    // Of (focus distance mm, f-number, sigma^2 px^2).
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    // Pieces of edges: nearer than focus or farther by a disk over 0.5 px; all that were used.
    int edges_nearer = 0, edges_farther = 0, edges = 0;
    double largest_blur_px = 0.0;  // radius, over the pieces used
    int degrees_of_freedom = 0;
};

// Of the camera only intrinsics and pixel pitch are used. All photographs at one setting of the
// lens. Throws NumericalError for a telecentric camera, without a pixel pitch, or with fewer than
// 12 edges. About 0.5 ms an edge. Safe from every thread.
DefocusEstimate estimate_defocus(std::span<const StraightEdge> edges, const CameraModel& camera);

}  // namespace etalon
