#include "compare/diagnosis/axis_spectrum.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace etalon {

AxisSpectrum::AxisSpectrum(const StageAxisMotion& axis, const Eigen::VectorXd& white_advance,
                           const Eigen::VectorXd& residual, const Eigen::MatrixXd& absorbed)
    : positions_(
          Eigen::Map<const Eigen::VectorXd>(axis.position.data(), std::ssize(axis.position))) {
    const Eigen::Index poses = positions_.size(), rows = white_advance.size() / poses;
    told_.resize(poses);
    weight_.resize(poses);
    absorbed_.resize(absorbed.cols(), poses);
    for (Eigen::Index i = 0; i < poses; ++i) {
        const auto advance = white_advance.segment(i * rows, rows);
        told_[i] = advance.dot(residual.segment(i * rows, rows));
        weight_[i] = advance.squaredNorm();
        absorbed_.col(i) = absorbed.middleRows(i * rows, rows).transpose() * advance;
    }
}

// How much of the residual's square sines and cosines explain, of each frequency from `first`
// up to `last`: from one to the next every position's phase turns by its own constant.
std::vector<double> AxisSpectrum::powers(double first, double last, double step) const {
    using namespace std::complex_literals;
    const Eigen::ArrayXcd turns = 2.0i * std::numbers::pi * positions_.array();
    Eigen::ArrayXcd phase = (first * turns).exp();
    const Eigen::ArrayXcd next = (step * turns).exp();
    std::vector<double> all;
    for (double frequency = first; frequency <= last; frequency += step, phase *= next)
        all.push_back(power(phase));
    return all;
}

std::vector<double> AxisSpectrum::periods(double shortest, int& tried) const {
    constexpr int per_resolution = 8, most_periods = 4;
    constexpr double as_good = 6.0, as_good_part = 0.03;
    const double travel = positions_.maxCoeff() - positions_.minCoeff();
    tried = static_cast<int>(2.0 * travel / shortest) - 1;
    if (tried < 1)
        return {};
    const double step = 0.5 / travel / per_resolution;
    const double first = (2 * per_resolution - 1) * step;
    const std::vector<double> powers = this->powers(first, 1.0 / shortest + step, step);
    const double highest = *std::ranges::max_element(powers);
    const double least = highest - std::max(as_good, as_good_part * highest);
    std::vector<double> found;
    for (std::size_t k = 1; k + 1 < powers.size() && found.size() < most_periods; ++k)
        if (powers[k] >= least && powers[k] >= powers[k - 1] && powers[k] > powers[k + 1])
            found.push_back(1.0 / (first + step * static_cast<double>(k)));
    return found;
}

double AxisSpectrum::power(const Eigen::ArrayXcd& phase) const {
    Eigen::MatrixXd waves(phase.size(), 2);
    waves << phase.imag(), phase.real();
    const Eigen::Vector2d seen = waves.transpose() * told_;
    const Eigen::MatrixXd lost = absorbed_ * waves;
    const Eigen::Matrix2d information =
        waves.transpose() * weight_.asDiagonal() * waves - lost.transpose() * lost;
    if (!(information.determinant() > 1e-6 * std::pow(information.trace(), 2)))
        return 0.0;  // one wave of the two is lost
    return seen.dot(information.inverse() * seen);
}

}  // namespace etalon
