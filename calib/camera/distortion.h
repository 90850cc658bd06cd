// OpenCV's distortion with its Jacobian: rational radial (and k7), tangential, thin prism, then the
// tilted sensor. Formulas: OpenCV's calib3d; the tilt is its matTilt, a projective map after the
// others. Where the model may be used: calib/camera/valid_region.h.
#pragma once

#include "calib/camera/camera_model.h"

namespace etalon {

struct Distorted {
    Eigen::Vector2d point;     // on the plane of the projection
    Eigen::Matrix2d jacobian;  // d point / d undistorted
    double denominator;        // of the rational radial part; <= 0 beyond a pole
    double tilt_depth = 1.0;   // third homogeneous coordinate of the tilt; <= 0 behind its horizon

    // Whether the model is locally invertible here, on this side of every pole. False for NaN.
    bool is_regular() const {
        return denominator > 0.0 && tilt_depth > 0.0 && jacobian.determinant() > 0.0 &&
               point.allFinite();
    }
};

// The distortion of a point on the plane of the projection, wherever it is finite. Tens of
// ns; with a tilt also four trigonometric functions.
Distorted distort(const Distortion& distortion, const Eigen::Vector2d& undistorted);

// The two halves of distort(): everything before the tilt, and the tilt of its result.
Distorted distort_before_tilt(const Distortion& distortion, const Eigen::Vector2d& undistorted);
Distorted apply_tilt(const Eigen::Matrix3d& tilt, const Distorted& before);

// The projective map of a sensor tilted by tau_x about x, then tau_y about y (rad).
Eigen::Matrix3d tilt_matrix(double tau_x, double tau_y);

}  // namespace etalon
