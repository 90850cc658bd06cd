// A straight edge's profile from an optical transfer function, as tables over the distance.
//
//     E(d) = 1/2 + integral over f > 0 of T(f) sin(2 pi f d) / (pi f) df
//     L(d) = E'(d) = integral over f > 0 of 2 T(f) cos(2 pi f d) df
//
// T is real and even: point-symmetric blur only. It is taken to vanish beyond `max_frequency`;
// of a pixel box alone that leaves 5e-4 of the contrast out at an edge along the pixels, of a box
// with a Gaussian of sigma >= 0.2 px nothing.
#pragma once

#include <Eigen/Core>

namespace etalon {

inline constexpr double max_frequency = 5.0;  // cycles per px

// Transfer of a square pixel along a unit direction in the image: sinc(f nx) sinc(f ny).
Eigen::ArrayXd pixel_transfer(const Eigen::ArrayXd& cycles_per_px, const Eigen::Vector2d& normal);

// Transfer of a uniform disk of this radius: 2 J1(q)/q, q = 2 pi f radius; and its derivative with
// respect to the radius squared, which is smooth where the radius is zero.
struct DiskTransfer {
    double value, by_radius_squared;
};
DiskTransfer disk_transfer(double frequency, double radius);

// Transfer of the Airy pattern at f lambda N_w (0 from 1 on), and its derivative.
struct AiryTransfer {
    double value, derivative;
};
AiryTransfer airy_transfer(double f_lambda_n);

// Safe from every thread once built; building costs reach^2 / 100 ms.
class EdgeResponse {
public:
    // For distances of up to `reach_px`, in (0, 100] (NumericalError otherwise).
    explicit EdgeResponse(double reach_px);

    // At which transfer functions are wanted, cycles per px.
    const Eigen::ArrayXd& frequencies() const { return frequencies_; }

    // E - 1/2 (or what a derivative of T does to it), and L, at distances of step() from 0 on.
    Eigen::ArrayXd odd_table(const Eigen::ArrayXd& transfer) const {
        return (sines_ * transfer.matrix()).array();
    }
    Eigen::ArrayXd even_table(const Eigen::ArrayXd& transfer) const {
        return (cosines_ * transfer.matrix()).array();
    }
    static constexpr double step() { return 1.0 / 16.0; }

private:
    Eigen::ArrayXd frequencies_;
    Eigen::MatrixXd sines_, cosines_;  // distances x frequencies, quadrature weights included
};

// E and L at any distance from both tables: E by cubic Hermite interpolation (error 3e-6 behind a
// pixel), L and `odd_at` by straight lines. Beyond the table the last value holds.
struct EdgeValue {
    double response, spread;
};
EdgeValue edge_value(const Eigen::ArrayXd& odd, const Eigen::ArrayXd& even, double distance_px);
double odd_at(const Eigen::ArrayXd& odd, double distance_px);

}  // namespace etalon
