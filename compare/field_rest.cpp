#include "compare/field_rest.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <cmath>

#include "core/errors.h"

namespace etalon {
namespace {

constexpr double coverage_factor = 2.0;
constexpr double limit_sigmas = 3.0902;  // one-sided 99.9 %

void require_usable(std::span<const FieldSample> samples, std::span<const SampleNoise> noise) {
    if (samples.size() != noise.size())
        throw NumericalError(fmt::format("field rest: {} samples with the noise of {}",
                                         samples.size(), noise.size()));
    for (const SampleNoise& each : noise)
        if (!each.covariance.allFinite() || !(each.covariance.trace() > 0.0) ||
            !(each.degrees_of_freedom > 0.0))
            throw NumericalError("field rest: a sample's noise is not finite and positive");
}

Eigen::VectorXd stacked_errors(std::span<const FieldSample> samples) {
    Eigen::VectorXd errors(3 * std::ssize(samples));
    for (std::size_t i = 0; i < samples.size(); ++i)
        errors.segment<3>(static_cast<Eigen::Index>(3 * i)) = samples[i].error;
    return errors;
}

Eigen::MatrixXd stacked_covariance(std::span<const SampleNoise> noise) {
    const auto rows = 3 * std::ssize(noise);
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(rows, rows);
    for (std::size_t i = 0; i < noise.size(); ++i) {
        const auto k = static_cast<Eigen::Index>(3 * i);
        covariance.block<3, 3>(k, k) = noise[i].covariance;
    }
    return covariance;
}

// Of Q = r^T W r with r = M e: what noise in e makes of it.
struct QuadraticForm {
    Eigen::MatrixXd kernel;      // M^T W M
    double mean = 0.0;           // for the stated noise
    double variance = 0.0;       // of Q for it
    double mean_variance = 0.0;  // of the mean, as the noise is itself an estimate
};

QuadraticForm form_of(const Eigen::MatrixXd& residual_maker, const Eigen::MatrixXd& weight,
                      const Eigen::MatrixXd& covariance, std::span<const SampleNoise> noise) {
    QuadraticForm form;
    form.kernel = residual_maker.transpose() * weight * residual_maker;
    const Eigen::MatrixXd spread = form.kernel * covariance;
    form.mean = spread.trace();
    form.variance = 2.0 * spread.cwiseProduct(spread.transpose()).sum();
    for (std::size_t i = 0; i < noise.size(); ++i) {
        const double share = spread.diagonal().segment<3>(static_cast<Eigen::Index>(3 * i)).sum();
        form.mean_variance += 2.0 * share * share / noise[i].degrees_of_freedom;
    }
    return form;
}

// The rest is taken as independent from sample to sample and alike in all directions: then a rest
// of mean square length s puts s t into |r|^2, t = trace(K) / 3. The upper end of the interval is
// the s with s = s_0 + k sigma(s), which grows with s itself.
void find_rest(const Eigen::VectorXd& residual, const QuadraticForm& form,
               const Eigen::MatrixXd& covariance, FieldRest& rest) {
    const double gain = form.kernel.trace() / 3.0;
    const double mean_square = std::max(0.0, (residual.squaredNorm() - form.mean) / gain);
    const Eigen::MatrixXd spread = form.kernel * covariance;
    const double mixed = 4.0 * spread.cwiseProduct(form.kernel.transpose()).sum() / 3.0;
    const double own = 2.0 * form.kernel.squaredNorm() / 9.0;
    double upper = mean_square;
    for (int round = 0; round < 100; ++round)
        upper = mean_square +
                coverage_factor / gain *
                    std::sqrt(form.variance + form.mean_variance + upper * (mixed + upper * own));
    rest.rms = std::sqrt(mean_square);
    rest.rms_uncertainty = std::sqrt(upper) - rest.rms;
}

}  // namespace

double chi_square_limit(double degrees_of_freedom) {
    const double c = 2.0 / (9.0 * degrees_of_freedom);
    return std::pow(1.0 - c + limit_sigmas * std::sqrt(c), 3);
}

FieldRest field_rest(const SmoothField& field, std::span<const FieldSample> samples,
                     std::span<const SampleNoise> noise) {
    require_usable(samples, noise);
    const Eigen::MatrixXd design = stacked_design(field, samples);
    const auto rows = design.rows();
    const Eigen::MatrixXd residual_maker =
        Eigen::MatrixXd::Identity(rows, rows) - design * estimator(field, samples);
    const Eigen::VectorXd residual = residual_maker * stacked_errors(samples);
    const Eigen::MatrixXd covariance = stacked_covariance(noise);

    FieldRest rest;
    rest.noise_rms = std::sqrt(covariance.trace() / static_cast<double>(samples.size()));
    const QuadraticForm plain =
        form_of(residual_maker, Eigen::MatrixXd::Identity(rows, rows), covariance, noise);
    find_rest(residual, plain, covariance, rest);

    const Eigen::MatrixXd weight = stacked_weight(field, samples);
    const QuadraticForm weighted = form_of(residual_maker, weight, covariance, noise);
    rest.chi_square_ratio = residual.dot(weight * residual) / weighted.mean;
    rest.degrees_of_freedom =
        2.0 * weighted.mean * weighted.mean / (weighted.variance + weighted.mean_variance);
    rest.chi_square_limit = chi_square_limit(rest.degrees_of_freedom);
    return rest;
}

}  // namespace etalon
