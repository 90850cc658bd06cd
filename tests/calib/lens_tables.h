// Projections with tables that several tests use, and rays by their angle to the axis and about it.
#pragma once

#include <cmath>
#include <complex>

#include "calib/camera/lens_projection.h"

namespace etalon::test {

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
