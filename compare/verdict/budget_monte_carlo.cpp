#include "compare/verdict/budget_monte_carlo.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "compare/verdict/length_error.h"
#include "core/distributions.h"
#include "core/errors.h"
#include "core/random.h"

namespace etalon {
namespace {

constexpr int draws = 2000;
constexpr std::uint32_t stream = 1;  // summarize() draws from stream 0

// What the figures of a field are taken from, as matrices on its coefficients.
class FieldFigures {
public:
    FieldFigures(const SmoothField& field, std::span<const FieldSample> samples,
                 std::span<const Eigen::Vector3d> positions)
        : lengthening_(pair_lengthening(samples) * stacked_design(field, samples)),
          power_(Eigen::MatrixXd::Zero(field.coefficients.size(), field.coefficients.size())) {
        for (const Eigen::Vector3d& position : positions) {
            const Eigen::MatrixXd design = field.design(position);
            power_ += design.transpose() * design / static_cast<double>(positions.size());
        }
        noise_power_ = power_.cwiseProduct(field.covariance).sum();
        const std::vector<Eigen::Vector3d> hull = hull_positions(positions);
        spread_.resize(3 * std::ssize(hull), field.coefficients.size());
        for (std::size_t i = 0; i < hull.size(); ++i)
            spread_.middleRows<3>(static_cast<Eigen::Index>(3 * i)) = field.design(hull[i]);
    }

    // Coefficients that carry noise `times` over: each puts its power into the square.
    double rms(const Eigen::VectorXd& c, double times) const {
        return std::sqrt(std::max(0.0, c.dot(power_ * c) - times * noise_power_));
    }
    double max(const Eigen::VectorXd& c) const {
        const Eigen::VectorXd all = spread_ * c;
        return all.reshaped(3, all.size() / 3).colwise().norm().maxCoeff();
    }
    double length_max(const Eigen::VectorXd& c) const {
        return (lengthening_ * c).cwiseAbs().maxCoeff();
    }

private:
    Eigen::MatrixXd lengthening_, power_, spread_;
    double noise_power_ = 0.0;
};

// The square root of degrees of freedom over chi-square: a normal deviate times it is one of
// Student's distribution.
double student_scale(RandomStream& random, double degrees_of_freedom) {
    if (!std::isfinite(degrees_of_freedom))
        return 1.0;
    return 1.0 / std::sqrt(std::max(1e-3, reduced_chi_square(random.normal(), degrees_of_freedom)));
}

double deviate(RandomStream& random, Distribution distribution) {
    return distribution == Distribution::uniform
               ? std::numbers::sqrt3 * (2.0 * random.uniform() - 1.0)
               : random.normal();
}

// The coefficients' change in one draw.
Eigen::VectorXd drawn(RandomStream& random, const Eigen::MatrixXd& ways, Distribution distribution,
                      double degrees_of_freedom) {
    const double scale = student_scale(random, degrees_of_freedom);
    Eigen::VectorXd amplitude(ways.cols());
    for (double& value : amplitude)
        value = scale * deviate(random, distribution);
    return ways * amplitude;
}

double quantile(std::vector<double>& values) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(coverage_probability * draws);
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

}  // namespace

MonteCarloUncertainty monte_carlo_uncertainty(const SmoothField& field,
                                              std::span<const FieldSample> samples,
                                              std::span<const Eigen::Vector3d> positions_mm,
                                              std::span<const FieldInput> inputs,
                                              std::uint64_t seed) {
    const FieldFigures figures(field, samples, positions_mm);
    const Eigen::MatrixXd from_samples = estimator(field, samples);
    std::vector<Eigen::MatrixXd> ways;
    for (const FieldInput& input : inputs) {
        if (input.shifts.rows() != from_samples.cols())
            throw NumericalError(fmt::format("Monte Carlo: an input of {} rows for {} samples",
                                             input.shifts.rows(), samples.size()));
        ways.emplace_back(from_samples * input.shifts);
    }
    const Eigen::MatrixXd noise = covariance_factor(field);
    std::vector<double> rms, max, length;
    for (int draw = 0; draw < draws; ++draw) {
        RandomStream random(seed, stream, static_cast<std::uint64_t>(draw));
        Eigen::VectorXd c = field.coefficients +
                            drawn(random, noise, Distribution::normal, field.degrees_of_freedom);
        for (std::size_t i = 0; i < ways.size(); ++i)
            c += drawn(random, ways[i], inputs[i].distribution, inputs[i].degrees_of_freedom);
        rms.push_back(figures.rms(c, 2.0));
        max.push_back(figures.max(c));
        length.push_back(figures.length_max(c));
    }
    const auto beyond = [](std::vector<double>& values, double value) {
        return std::max(0.0, quantile(values) - value);
    };
    return {beyond(rms, figures.rms(field.coefficients, 1.0)),
            beyond(max, figures.max(field.coefficients)),
            beyond(length, figures.length_max(field.coefficients))};
}

}  // namespace etalon
