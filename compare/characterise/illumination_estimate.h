// Relative illumination: how the light falls off from the axis to the image's corners, from
// photographs of a uniform field or from the white squares of a target in many places.
//
//     radiance = L_p (1 + a_p x + b_p y) P(r),   P = 1 + c1 r^2 + c2 r^4 + c3 r^6
//
// Every photograph p has its own level and plane (x, y from the image's centre in half diagonals),
// which take a field's unevenness of first order. What is symmetric about the principal point looks
// like the lens. Candidates, by Schwarz's criterion with the polynomial's residuals as the scatter:
// uniform, cos^4 of the field angle, and the polynomial.
#pragma once

#include <array>
#include <span>

#include "calib/camera/projector.h"
#include "core/geometry/rigid.h"
#include "sim/marker/marker.h"

namespace etalon {

// A part of a photograph that is white and even: linear radiance, mean over its pixels.
struct WhitePatch {
    int photo = 0;  // 0, 1, ...: whose level and plane it shares
    Eigen::Vector2d centre_px = Eigen::Vector2d::Zero();
    double radiance = 0.0, standard_uncertainty = 0.0;
};

// Blocks of a flat-field photograph. Throws NumericalError, naming `name`, when over 0.1 % of the
// pixels are saturated or at code 0, or its blocks differ by over a factor of 20.
std::vector<WhitePatch> flat_patches(const CodeImage& flat, const CameraModel& camera, int photo,
                                     const std::string& name);

// The middles of a target's white cells: pixels at least 4 px and a quarter of a cell inside.
// Saturated ones are left out, and cells with fewer than 9 pixels.
std::vector<WhitePatch> white_cell_patches(const CodeImage& image, const Projector& projector,
                                           const CellGrid& grid, const Rigid& camera_from_marker,
                                           int photo);

struct IlluminationEstimate {
    Illumination illumination;  // of the chosen kind
    // Of the polynomial, whichever is chosen.
    std::array<double, 3> coefficients{}, standard_uncertainty{};
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    // The polynomial in the corner that is farthest from the principal point.
    double at_corner = 1.0, at_corner_standard_uncertainty = 0.0;
    double reduced_chi_square = 0.0;  // of the polynomial; over 1: multiplied into the covariance
    double residual_rms = 0.0;        // relative
    double farthest_radius = 0.0;     // of a patch, half diagonals: beyond it is extrapolated
    int photos = 0, patches = 0, degrees_of_freedom = 0;
    std::vector<WhitePatch> used;  // radiance divided by its photograph's level and plane
};

// Standard uncertainty of the polynomial at a radius in half diagonals.
double standard_uncertainty_at(const IlluminationEstimate& estimate, double radius);

// Photographs with fewer than 4 patches are left out. Throws NumericalError for fewer than 20
// patches, none beyond 0.6 half diagonals, residuals over 5 %, U over 0.05 (k = 2) in the corner,
// or a polynomial that is not positive all over the image. Safe from every thread; some 10 ms for
// 20 photographs.
IlluminationEstimate estimate_illumination(std::span<const WhitePatch> patches,
                                           const CameraModel& camera);

}  // namespace etalon
