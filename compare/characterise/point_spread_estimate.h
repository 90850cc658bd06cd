// How the lens spreads a point, from the edges of a known target: what `lens: psf` of the camera
// file holds, each with its standard uncertainty.
//
// An edge's profile is the point spread's line integral, convolved with the pixel box as the edge
// lies on it, integrated. The fit (compare/edges/edge_fit.h) is on pixels, all edges at once:
// nothing is differentiated or binned. Which shape: a Gaussian in place of the Airy pattern (psf:
// gaussian); a Gaussian beside it (how far the lens is from diffraction limited); or any round
// pattern whose density does not rise outwards (psf: measured), as non-negative weights of disks
// with sloping rims. Defocus: where the camera's lens section says f-number and focus, the first
// two leave its blur out of what they find; the measured pattern holds it.
//
// Sharpening in the camera: no pattern of light overshoots an edge in linear radiance. An overshoot
// that is significant means that the camera (or a wrong transfer curve) made it; then sigma and
// profile describe no lens and are not to be written into a camera file.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "calib/camera/camera_model.h"
#include "compare/edges/edge_spread.h"

namespace etalon {

// A Gaussian's width, of the edges in one zone or of all. Standard uncertainty: the larger of the
// formal one (from the noise, times the residuals' excess over it) and, from 8 edges, the one that
// the scatter between edges gives (cluster-robust).
struct BlurWidth {
    double sigma_px = 0.0, standard_uncertainty_px = 0.0;
    // sigma^2 and its uncertainty: what is estimated; near sigma = 0 this one is still normal.
    double variance_px2 = 0.0, variance_standard_uncertainty_px2 = 0.0;
    double reduced_chi_square =
        0.0;                    // of the noise model's; without a known gain 1 by construction
    double residual_rms = 0.0;  // in parts of the edges' contrast
    int edges = 0, pixels = 0, degrees_of_freedom = 0, outlying_edges = 0;
};

// One bin of the mean profile: parts of the contrast, 0 on the dark side, 1 on the light one.
struct EdgeSpreadRow {
    double distance_px, value, standard_uncertainty;
    int pixels;
};

inline constexpr double min_overshoot = 0.01;  // of the contrast: less is not called sharpening

struct Sharpening {
    // Largest mean of half a pixel of the profile above the light side's level (below the dark
    // side's), in parts of the contrast, between 0.5 and 4 px from the edge; negative: none.
    double overshoot = 0.0, overshoot_standard_uncertainty = 0.0;
    double undershoot = 0.0, undershoot_standard_uncertainty = 0.0;
    // One of them is above min_overshoot by more than 4 standard uncertainties.
    bool is_detected = false;
};

struct ProfileRow {
    double radius_px, density, standard_uncertainty;  // energy per px^2; the whole is 1
};

struct MeasuredSpread {
    std::vector<ProfileRow> rows;  // as `psf: measured` holds it
    Eigen::MatrixXd covariance;    // of the densities
    double reduced_chi_square = 0.0, residual_rms = 0.0;
    int degrees_of_freedom = 0, parameters = 0;

    // For the camera file.
    std::vector<std::pair<double, double>> profile() const;
    // Modulation at a frequency in cycles per px along x (pixel box not included), and its standard
    // uncertainty.
    std::pair<double, double> modulation(double cycles_per_px) const;
};

struct PointSpreadEstimate {
    BlurWidth gaussian;  // of all edges
    // 3 x 3 zones of the image, row by row; nothing where a zone has fewer than 4 edges.
    std::array<std::optional<BlurWidth>, 9> zones;
    std::optional<MeasuredSpread> measured;  // nothing: too few edges for a profile (below 8)
    // F statistic of the measured pattern against the Gaussian and the probability of a larger one
    // if the pattern is a Gaussian; and which of them to write.
    double f_statistic = 0.0, f_probability = 1.0;
    bool gaussian_suffices = true;
    std::vector<EdgeSpreadRow> edge_spread;
    Sharpening sharpening;
};

// Of the edges' mean profile alone, with the Gaussian that fits them: edges with clipped pixels
// will do (EdgeSelection::with_clipped). Errors as below.
Sharpening measure_sharpening(std::span<const StraightEdge> edges, const CameraModel& camera);

// Edges of one or several photographs (all with one camera). Throws NumericalError for fewer than 4
// edges and when a fit does not converge. About 0.1 ms an edge for a width, ten times that for the
// profile. Safe from every thread.
PointSpreadEstimate estimate_point_spread(std::span<const StraightEdge> edges,
                                          const CameraModel& camera);

}  // namespace etalon
