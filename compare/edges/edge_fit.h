// Fits a blur that many edges share, and of each edge its levels and its place:
//
//     radiance = dark + (step + g_n d + g_t t) E(d - shift - turn t)
//
// d is a pixel's distance from the edge, t its place along it, E the profile of pixel box and lens.
// Only the light side's illumination varies (g). The six parameters of each edge are eliminated
// from the normal equations (Schur complement).
#pragma once

#include <functional>

#include "compare/edges/edge_spread.h"
#include "sim/scene/marker_view.h"

namespace etalon {

inline constexpr double max_frequency = 5.0;  // cycles per px: transfers are taken as 0 beyond

// Transfer of a square pixel along a unit direction in the image: sinc(f nx) sinc(f ny).
Eigen::ArrayXd pixel_transfer(const Eigen::ArrayXd& cycles_per_px, const Eigen::Vector2d& normal);

// Transfer of a uniform disk: 2 J1(q)/q, q = 2 pi f radius. Its derivative by the radius squared is
// smooth where the radius is zero.
struct DiskTransfer {
    double value, by_radius_squared;
};
DiskTransfer disk_transfer(double frequency, double radius);

// A straight edge's profile from a real and even optical transfer function T:
//
//     E(d) = 1/2 + integral over f > 0 of T(f) sin(2 pi f d) / (pi f) df
//     L(d) = E'(d) = integral over f > 0 of 2 T(f) cos(2 pi f d) df
//
// Cutting T at max_frequency costs a pixel box alone 5e-4 of the contrast. Building costs
// reach^2 / 100 ms. Safe from every thread.
class EdgeResponse {
public:
    // Distances up to `reach_px` in (0, 100]; NumericalError otherwise.
    explicit EdgeResponse(double reach_px);

    const Eigen::ArrayXd& frequencies() const { return frequencies_; }  // of T, cycles per px

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

// E (cubic Hermite interpolation, error 3e-6 behind a pixel) and L (linear) from both tables.
// Beyond the table the last value holds.
struct EdgeValue {
    double response, spread;
};
EdgeValue edge_value(const Eigen::ArrayXd& odd, const Eigen::ArrayXd& even, double distance_px);

// A family of lens blurs (without the pixel box) by a few parameters.
struct BlurModel {
    Eigen::VectorXd start, lower;  // of the parameters
    bool are_parts = false;        // the parameters' sum is fixed at 1
    // Along the edge's normal at the frequencies; a column of derivatives for each parameter.
    struct Transfer {
        Eigen::ArrayXd value;
        Eigen::MatrixXd derivative;
    };
    std::function<Transfer(const StraightEdge& edge, const Eigen::VectorXd& parameters,
                           const Eigen::ArrayXd& cycles_per_px)>
        transfer;
};

struct FittedEdge {
    // dark, step, g_n, g_t, shift (px), turn
    Eigen::Matrix<double, 6, 1> own = Eigen::Matrix<double, 6, 1>::Zero();
    double reduced_chi_square = 0.0;
    bool is_outlier = false;        // not used: its chi-square is far above the others'
    std::vector<double> residuals;  // radiance, by pixel

    // A pixel's distance from the fitted edge, and the step there.
    double place_px(const EdgePixel& pixel) const {
        return pixel.distance_px - own[4] - own[5] * pixel.along_px;
    }
    double height(const EdgePixel& pixel) const {
        return own[1] + own[2] * pixel.distance_px + own[3] * pixel.along_px;
    }
};

struct EdgeFit {
    Eigen::VectorXd parameters;
    // Noise times the residuals' excess over it; from 8 edges on enlarged to what the scatter of
    // the edges' scores says (sandwich, mean over the parameters). A bound does not lower it.
    Eigen::MatrixXd covariance;
    std::vector<bool> is_at_bound;
    std::vector<FittedEdge> edges;
    double reduced_chi_square = 0.0;
    double residual_rms = 0.0;  // in parts of each edge's step
    int degrees_of_freedom = 0, used_edges = 0;
};

// An edge's pixels less its own six parameters.
int own_freedom(const StraightEdge& edge);

// Gauss-Newton with bounds. Edges whose reduced chi-square is over 4 times the median are left out
// and the rest fitted again. Throws NumericalError when it does not converge, there are fewer
// pixels than parameters, or the edges do not determine the blur.
EdgeFit fit_edges(std::span<const StraightEdge> edges, const BlurModel& model);

// Of a thin lens' blur disk along the edge's normal, px^2, mean over the edge's length. `focus` is
// a depth term.
double disk_radius_squared(const StraightEdge& edge, double aperture_mm, double focus);

// Along the edge's normal, of a Gaussian (variance in px^2 of the pitch along x) and a disk.
struct BlurTransfer {
    Eigen::ArrayXd value, by_variance, by_radius_squared;
};
BlurTransfer blur_transfer(const StraightEdge& edge, double variance_px2, double radius_squared_px2,
                           const Eigen::ArrayXd& cycles_per_px);

// One parameter, a Gaussian's variance in px^2 (of the pitch along x), with the known blur disk.
BlurModel gaussian_blur(const Aperture& aperture = {});

// Variance along the normal of the Gaussian that fits one edge's pixels best.
struct EdgeWidth {
    double variance_px2 = 0.0, deviation_px2 = 0.0;
};
EdgeWidth edge_width(const StraightEdge& edge);

// Round patterns whose density does not rise outwards: parts of unit energy, flat to one of the
// radii (0, r1, ...) and falling linearly to zero at the next.
class SlopingDisks {
public:
    explicit SlopingDisks(std::vector<double> radii_px) : radii_(std::move(radii_px)) {}  // rising

    BlurModel model() const;  // with the parts as parameters

    // Density at 0 and at the radii by part: (radii + 1) x radii.
    Eigen::MatrixXd density_by_part() const;

    // Transfer of part k at a frequency, cycles per px.
    double transfer(Eigen::Index k, double frequency) const;

private:
    Eigen::Index parts() const { return static_cast<Eigen::Index>(radii_.size()); }
    double outer(Eigen::Index k) const { return radii_[static_cast<std::size_t>(k)]; }
    double inner(Eigen::Index k) const { return k == 0 ? 0.0 : outer(k - 1); }

    std::vector<double> radii_;
};

}  // namespace etalon
