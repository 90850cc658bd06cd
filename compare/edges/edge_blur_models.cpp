#include "compare/edges/edge_blur_models.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "compare/edges/edge_response.h"

namespace etalon {
namespace {

using std::numbers::pi;

constexpr double start_variance_px2 = 0.3;
constexpr double min_step = 1.0 / 256.0;  // cycles per px, of the tabulated transfers

// Gauss and Legendre's rule with 5 points on [0, 1].
constexpr std::array<std::pair<double, double>, 5> gauss_legendre_pairs = {
    {{0.0469100770306680, 0.1184634425280945},
     {0.2307653449471585, 0.2393143352496832},
     {0.5, 0.2844444444444444},
     {0.7692346550528415, 0.2393143352496832},
     {0.9530899229693320, 0.1184634425280945}}};

// Volume of the pattern of height 1, flat to a and falling to zero at b.
double volume(double a, double b) {
    return pi / 3.0 * (a * a + a * b + b * b);
}

}  // namespace

double defocus_radius_px(const StraightEdge& edge, const Aperture& aperture) {
    const double focus =
        aperture.faces_rays ? aperture.focus_on_axis : aperture.focus(edge.undistorted);
    const double defocus = edge.depth_term - focus;
    return aperture.radius_mm * edge.px_per_unit *
           std::sqrt(defocus * defocus + edge.depth_term_variance);
}

BlurModel gaussian_width() {
    BlurModel model;
    model.start = Eigen::VectorXd::Constant(1, 0.5);
    model.lower = Eigen::VectorXd::Zero(1);
    model.transfer = [](const StraightEdge&, const Eigen::VectorXd& p, const Eigen::ArrayXd& f) {
        const Eigen::ArrayXd fall = -2.0 * pi * pi * f.square();
        BlurModel::Transfer result{(fall * p[0]).exp(), {}};
        result.derivative = fall * result.value;
        return result;
    };
    return model;
}

BlurModel gaussian_blur(const Aperture& aperture, double lambda_n_px) {
    BlurModel model;
    model.start = Eigen::VectorXd::Constant(1, start_variance_px2);
    model.lower = Eigen::VectorXd::Zero(1);
    model.transfer = [=](const StraightEdge& edge, const Eigen::VectorXd& parameters,
                         const Eigen::ArrayXd& frequencies) {
        const double scale = edge.px_per_pitch, radius = defocus_radius_px(edge, aperture);
        BlurModel::Transfer result{Eigen::ArrayXd(frequencies.size()),
                                   Eigen::MatrixXd(frequencies.size(), 1)};
        for (Eigen::Index i = 0; i < frequencies.size(); ++i) {
            const double f = frequencies[i], q = f * scale;
            const double fall = -2.0 * pi * pi * q * q;
            result.value[i] = std::exp(fall * parameters[0]) * disk_transfer(f, radius).value *
                              (lambda_n_px > 0.0 ? airy_transfer(q * lambda_n_px).value : 1.0);
            result.derivative(i, 0) = fall * result.value[i];
        }
        return result;
    };
    return model;
}

SlopingDisks::SlopingDisks(std::vector<double> radii_px) : radii_(std::move(radii_px)) {}

// A sloping disk is the mean of uniform disks of the radii s between its own two, by their energy
// s^2.
double SlopingDisks::transfer(std::size_t k, double frequency) const {
    const double a = inner(k), b = radii_[k];
    double sum = 0.0, energy = 0.0;
    for (const auto& [node, weight] : gauss_legendre_pairs) {
        const double s = a + (b - a) * node;
        sum += weight * s * s * disk_transfer(frequency, s).value;
        energy += weight * s * s;
    }
    return sum / energy;
}

Eigen::MatrixXd SlopingDisks::density_by_part() const {
    const auto n = static_cast<Eigen::Index>(radii_.size());
    Eigen::MatrixXd density = Eigen::MatrixXd::Zero(n + 1, n);
    for (Eigen::Index k = 0; k < n; ++k) {
        const auto part = static_cast<std::size_t>(k);
        density.col(k).head(k + 1).setConstant(1.0 / volume(inner(part), radii_[part]));
    }
    return density;
}

// The transfers are tabulated once: an edge only scales their frequencies by a little.
BlurModel SlopingDisks::model() const {
    const auto n = static_cast<Eigen::Index>(radii_.size());
    constexpr double room = 1.5;  // for pixels that are not square
    const auto rows = static_cast<Eigen::Index>(room * max_frequency / min_step) + 2;
    auto table = std::make_shared<Eigen::MatrixXd>(rows, n);
    for (Eigen::Index i = 0; i < rows; ++i)
        for (Eigen::Index k = 0; k < n; ++k)
            (*table)(i, k) =
                transfer(static_cast<std::size_t>(k), static_cast<double>(i) * min_step);
    BlurModel model;
    model.start = Eigen::VectorXd::Constant(n, 1.0 / static_cast<double>(n));
    model.lower = Eigen::VectorXd::Zero(n);
    model.are_parts = true;
    model.transfer = [table](const StraightEdge& edge, const Eigen::VectorXd& parameters,
                             const Eigen::ArrayXd& frequencies) {
        BlurModel::Transfer result{Eigen::ArrayXd(),
                                   Eigen::MatrixXd(frequencies.size(), parameters.size())};
        for (Eigen::Index i = 0; i < frequencies.size(); ++i) {
            const double at = frequencies[i] * edge.px_per_pitch / min_step;
            const auto cell = std::min(static_cast<Eigen::Index>(at), table->rows() - 2);
            const double part = std::min(at - static_cast<double>(cell), 1.0);
            result.derivative.row(i) =
                (1.0 - part) * table->row(cell) + part * table->row(cell + 1);
        }
        result.value = (result.derivative * parameters).array();
        return result;
    };
    return model;
}

}  // namespace etalon
