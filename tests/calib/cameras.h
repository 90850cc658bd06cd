// Cameras that several tests of calib/ use: those of the published renderer comparison, and hard
// ones.
#pragma once

#include <cmath>
#include <complex>
#include <optional>

#include "calib/camera/lens_projection.h"
#include "calib/camera/projector.h"
#include "core/geometry/rigid.h"

namespace etalon::test {

inline CameraModel camera_with(int width, int height, Intrinsics intrinsics,
                               Distortion distortion = {}, const std::optional<Sensor>& sensor = {},
                               const std::optional<Lens>& lens = {}) {
    CameraModel camera;
    camera.width = width;
    camera.height = height;
    camera.intrinsics = intrinsics;
    camera.distortion = distortion;
    camera.sensor = sensor;
    camera.lens = lens;
    return camera;
}

// Where the camera sees a marker's points.
inline std::vector<Eigen::Vector2d> corners_at(const Projector& projector,
                                               const std::vector<Eigen::Vector3d>& points,
                                               const Rigid& camera_from_marker) {
    std::vector<Eigen::Vector2d> corners;
    for (const Eigen::Vector3d& point : points)
        corners.push_back(projector.project(camera_from_marker * point).value());
    return corners;
}

// A webcam whose numbers the published comparison of markers shows (FMAC, arXiv 2601.07723).
inline CameraModel study_webcam(double focus_mm, double gain_e_per_dn, double read_noise_e) {
    return camera_with(
        640, 480, {822.317, 822.317, 319.495, 242.502},
        {.k1 = -0.0449369, .k2 = 1.17277, .k3 = -3.63244},
        Sensor{.pixel_pitch_um = 2.8, .gain_e_per_dn = gain_e_per_dn, .read_noise_e = read_noise_e},
        Lens{1.8, focus_mm, 600.0, {}});
}

inline CameraModel with_tone_curve(CameraModel camera) {
    camera.sensor->transfer.kind = Transfer::Kind::rec709;
    return camera;
}

inline CameraModel webcam() {
    return camera_with(640, 480, {538.55, 538.55, 319.5, 239.5},
                       {.k1 = -0.286, .k2 = 0.057, .k3 = 0.112});
}

// k3 = -40: folds just outside the image's corners.
inline CameraModel canon() {
    const double f = 26.49 / 0.0057;
    return camera_with(2816, 1880, {f, f, 1407.5, 939.5},
                       {.k1 = -0.125, .k2 = 3.855, .k3 = -40.371});
}

// Every coefficient at work, nothing symmetric.
inline CameraModel all_fourteen() {
    return camera_with(700, 500, {611.0, 587.0, 361.0, 239.0},
                       {.k1 = 0.31,
                        .k2 = -0.12,
                        .p1 = 0.0021,
                        .p2 = -0.0034,
                        .k3 = 0.05,
                        .k4 = 0.41,
                        .k5 = -0.08,
                        .k6 = 0.03,
                        .s1 = 0.0031,
                        .s2 = -0.0012,
                        .s3 = -0.0023,
                        .s4 = 0.0017,
                        .tau_x = 0.07,
                        .tau_y = -0.11});
}

// 160 degrees across the diagonal: the Pade approximant of r_d = atan(r), an equidistant fisheye as
// far as the rational model can be one.
inline CameraModel wide_angle() {
    return camera_with(
        1000, 800, {300.0, 290.0, 503.0, 391.0},
        {.k1 = 735.0 / 945, .k2 = 64.0 / 945, .k4 = 1050.0 / 945, .k5 = 225.0 / 945});
}

// ---- Projections with tables that several tests use, and rays by their angle to the axis and
// about it.

inline constexpr double pi = std::numbers::pi;
using Complex = std::complex<double>;
using ComplexRay = Eigen::Matrix<Complex, 3, 1>;
using ComplexPoint = Eigen::Matrix<Complex, 2, 1>;

// The imaginary part of f(x + i h) / h is the derivative to rounding.
template <class Function, class Point>
Eigen::MatrixXd complex_step(const Function& f, const Point& at) {
    constexpr double h = 1e-30;
    using ComplexArgument = Eigen::Matrix<Complex, Point::RowsAtCompileTime, 1>;
    Eigen::MatrixXd derivatives(f(ComplexArgument(at.template cast<Complex>())).size(), at.size());
    for (Eigen::Index i = 0; i < at.size(); ++i) {
        ComplexArgument moved = at.template cast<Complex>();
        moved[i] += Complex(0.0, h);
        derivatives.col(i) = f(moved).imag() / h;
    }
    return derivatives;
}

inline Eigen::Vector3d ray_at(double angle, double azimuth, double length = 1.0) {
    return length * Eigen::Vector3d(std::sin(angle) * std::cos(azimuth),
                                    std::sin(angle) * std::sin(azimuth), std::cos(angle));
}

// With and without an end before 180 degrees, and with a stretch matrix's lower half.
inline std::vector<LensProjection> polynomials() {
    return {polynomial_projection(-0.31, 0.02, -0.011, 0.0),
            polynomial_projection(-0.27, 0.05, -0.021, 0.013),
            polynomial_projection(0.4, -0.3, 0.02, 0.0),
            polynomial_projection(0.0, 0.0, 0.0, -0.002)};
}

// CAHVOR with and without a fold, and CAHVORE's three kinds with a still pupil.
inline std::vector<LensProjection> cahvors() {
    return {cahvor_projection(0.013, -0.021, 1e-3, -0.061, 0.012),
            cahvor_projection(-0.011, 0.017, 0.002, 0.11, 0.03),
            cahvor_projection(0.013, -0.021, 1e-3, 0.031, -0.004, 0.37),
            cahvor_projection(0.013, -0.021, 1e-3, 0.021, -0.001, 0.0),
            cahvor_projection(-0.02, 0.01, 1e-3, 0.031, 0.004, -0.44)};
}

// Of 220 degrees along x, with control points in which nothing is alike.
inline LensProjection spline(int order, int columns, int rows) {
    std::vector<double> control;
    for (int row = 0; row < rows; ++row)
        for (int col = 0; col < columns; ++col) {
            const double x = col - 0.5 * (columns - 1), y = row - 0.5 * (rows - 1);
            control.push_back(0.003 * x - 0.0021 * x * y + 0.031 * std::sin(1.7 * col + row));
            control.push_back(-0.002 * y + 0.0013 * x * x +
                              0.029 * std::cos(0.9 * col - 2.0 * row));
        }
    return splined_projection(order, columns, rows, 220.0, control);
}
inline std::vector<LensProjection> splines() {
    return {spline(3, 14, 12), spline(2, 15, 13)};
}

}  // namespace etalon::test
