// Where the points of a calibration board really are: whether the residuals move with the board and
// not with the image, and the board's shape, fitted with the camera (docs/calibration.md).
//
// Lavest, Viala, Dhome (ECCV 1998) and Strobl and Hirzinger (ICCV Workshops 2011) free every point
// and hold three of them. Here every point has a prior, whose widths the photos tell (marginal
// likelihood: MacKay, "Bayesian interpolation", Neural Computation 4, 1992). Flat boards stay
// nearly flat, no point is special, and place, attitude and size of the whole stay as drawn.
//
// Frame: the board's as drawn, x and y in its plane, z = x cross y, mm. Thread-safe, deterministic.
// A board of n points costs n^3 in each of some tens of rounds: 0.1 s for 54 points.
#pragma once

#include "calib/intrinsics/camera_fit.h"

namespace etalon {

struct ShapedPoint {
    int id = 0;
    Eigen::Vector3d drawn_mm, displacement_mm;
    Eigen::Vector3d deviation_mm;  // one standard deviation of the displacement's coordinates
};

// Each point is displaced at random, normally about zero, in the plane and out of it. The whole is
// bowed and twisted (x^2, x y, y^2) by an RMS of a hundredth of its extent, that is by anything.
struct BoardPrior {
    double in_plane_mm = 0.0, out_of_plane_mm = 0.0;
};
inline constexpr double prior_bow_per_extent = 0.01;

struct DisplacementSize {
    double rms_mm = 0.0, rms_deviation_mm = 0.0, worst_mm = 0.0;  // of the displacements' lengths
};

struct BoardShape : DisplacementSize {
    std::vector<ShapedPoint> points;  // by id
    // d2z/dx2, d2z/dxdy, d2z/dy2 of the surface of second order through the points; 1/mm.
    Eigen::Vector3d curvature_per_mm = Eigen::Vector3d::Zero();
    Eigen::Vector3d curvature_deviation_per_mm = Eigen::Vector3d::Zero();
    BoardPrior prior;         // its widths as the photos tell them
    double variance = 0.0;    // of a pixel coordinate of sigma 1
    double parameters = 0.0;  // how many the shape is worth: the trace of its leverage
    // What the shape's uncertainty adds to the covariance of the model's parameters.
    Eigen::MatrixXd camera_covariance;
    bool converged = false;

    // The view with where its points really are.
    CalibrationView shaped(CalibrationView view) const;
};

// Minimises the squared weighted distances over their variance plus the displacements' over the
// prior's, in rounds: the camera for a board, then a Gauss-Newton step of the board with camera and
// poses eliminated. `fit` is the views' fit and the start; with `start` its prior's widths are
// held. Throws NumericalError as fit_camera() does, for an id in two places, too few points, and a
// telecentric camera, which does not tell heights and tilts from their opposites.
BoardShape fit_board_shape(std::span<const CalibrationView> views, const CameraFit& fit,
                           const std::optional<BoardShape>& start = std::nullopt);

// Whether residuals move with the board. What camera and poses can do, and a bicubic spline over
// the image, is projected off. With a true board, errors could have the other sign, photo by photo:
// `chance` is the share of sign changes (all, or 4095 drawn) after which a board explains as much
// (wild bootstrap: Wu, Ann. Statist. 14, 1986; Cameron, Gelbach, Miller, Rev. Econ. Stat. 90,
// 2008).
inline constexpr double max_board_chance = 0.01;
inline constexpr std::size_t min_board_views = 8;  // 2^7 signs: a chance of 1/128 can be seen

// Its size is of the part of the displacements that no field in the image can stand in for.
struct BoardFlatness : DisplacementSize {
    double chance = 1.0;
    double share = 0.0;  // of the variance of the residuals, less what noise would seem to

    bool is_distorted() const { return chance <= max_board_chance; }
};

// Nothing for fewer than min_board_views views, for points too few to tell, and for a telecentric
// camera. Throws NumericalError for an id in two places.
std::optional<BoardFlatness> check_board(std::span<const CalibrationView> views,
                                         const CameraFit& fit);

}  // namespace etalon
