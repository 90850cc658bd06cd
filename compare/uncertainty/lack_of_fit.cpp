#include "compare/uncertainty/lack_of_fit.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <string_view>

#include "compare/uncertainty/uncertainty_budget.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"

namespace etalon {
namespace {

constexpr double limit_sigmas = 3.0902;  // one-sided 99.9 %

void require_usable(std::span<const FieldSample> samples, std::span<const SampleNoise> noise,
                    const Eigen::MatrixXd& declared) {
    const auto require = [](bool is_usable, std::string_view otherwise) {
        if (!is_usable)
            throw NumericalError(fmt::format("lack of fit: {}", otherwise));
    };
    require(samples.size() == noise.size(), "samples and their noise do not agree");
    require(declared.cols() == 0 || declared.rows() == 3 * std::ssize(samples),
            "a declared error is not of these samples");
    require(declared.allFinite(), "a declared error is not finite");
    for (const SampleNoise& each : noise)
        require(each.covariance.allFinite() && each.covariance.trace() > 0.0 &&
                    each.degrees_of_freedom > 0.0,
                "a sample's noise is not finite and positive");
}

Eigen::VectorXd stacked_errors(std::span<const FieldSample> samples) {
    Eigen::VectorXd errors(3 * std::ssize(samples));
    for (std::size_t i = 0; i < samples.size(); ++i)
        errors.segment<3>(static_cast<Eigen::Index>(3 * i)) = samples[i].error;
    return errors;
}

// A square matrix with 3 rows for each sample, blocks on its diagonal and a product of two thin
// matrices beside them: B + L R^T. In full a run of 2000 poses would need a gigabyte for it.
struct BlocksAndThin {
    std::vector<Eigen::Matrix3d> blocks;
    Eigen::MatrixXd left, right;
};

double thin_trace(const Eigen::MatrixXd& left, const Eigen::MatrixXd& right) {
    return left.cwiseProduct(right).sum();
}

double trace(const BlocksAndThin& matrix) {
    double sum = thin_trace(matrix.left, matrix.right);
    for (const Eigen::Matrix3d& block : matrix.blocks)
        sum += block.trace();
    return sum;
}

Eigen::Matrix3d diagonal_block(const BlocksAndThin& matrix, std::size_t i) {
    const auto k = static_cast<Eigen::Index>(3 * i);
    return matrix.blocks[i] +
           matrix.left.middleRows<3>(k) * matrix.right.middleRows<3>(k).transpose();
}

// B x
Eigen::MatrixXd blocks_times(const BlocksAndThin& matrix, const Eigen::MatrixXd& x) {
    Eigen::MatrixXd product(x.rows(), x.cols());
    for (std::size_t i = 0; i < matrix.blocks.size(); ++i) {
        const auto k = static_cast<Eigen::Index>(3 * i);
        product.middleRows<3>(k).noalias() = matrix.blocks[i] * x.middleRows<3>(k);
    }
    return product;
}

Eigen::MatrixXd times(const BlocksAndThin& matrix, const Eigen::MatrixXd& x) {
    return blocks_times(matrix, x) + matrix.left * (matrix.right.transpose() * x);
}

// tr(A C)
double trace_of_product(const BlocksAndThin& a, const BlocksAndThin& c) {
    double sum =
        thin_trace(blocks_times(a, c.left), c.right) +
        thin_trace(a.left, times_blocks(a.right.transpose(), c.blocks).transpose()) +
        thin_trace((a.right.transpose() * c.left).transpose(), c.right.transpose() * a.left);
    for (std::size_t i = 0; i < a.blocks.size(); ++i)
        sum += (a.blocks[i] * c.blocks[i]).trace();
    return sum;
}

// The residuals r = M e of a fit with the weights W: M = I - D E, of the design D and the estimator
// E = (D^T W D)^-1 D^T W, has a symmetric W M. Declared errors S are fitted with the field, their
// standard uncertainty as prior: D becomes (D S), and to (D S)^T W (D S) a 1 is added for each.
class Residuals {
public:
    Residuals(const BiasField& field, std::span<const FieldSample> samples,
              const Eigen::MatrixXd& declared)
        : design_(stacked_design(field, samples)),
          estimator_(estimator(field, samples)),
          weights_(sample_weights(field, samples)) {
        if (declared.cols() > 0)
            fit_beside(declared);
    }

    Eigen::VectorXd of(const Eigen::VectorXd& errors) const {
        return errors - design_ * (estimator_ * errors);
    }

    // M^T M = I - D E - E^T (D - E^T D^T D)^T
    BlocksAndThin plain_kernel() const {
        const Eigen::Index rows = design_.rows(), columns = design_.cols();
        BlocksAndThin kernel{{weights_.size(), Eigen::Matrix3d::Identity()},
                             Eigen::MatrixXd(rows, 2 * columns),
                             Eigen::MatrixXd(rows, 2 * columns)};
        kernel.left << -design_, -estimator_.transpose();
        kernel.right << estimator_.transpose(),
            design_ - estimator_.transpose() * (design_.transpose() * design_);
        return kernel;
    }

    // W M = W - W D E: of the smallest r^T W r, with what declared errors pay for their sizes
    BlocksAndThin weighted_kernel() const {
        return {weights_, -times_blocks(design_.transpose(), weights_).transpose(),
                estimator_.transpose()};
    }

    // e^T W M e
    double weighted_square(const Eigen::VectorXd& errors) const {
        return times_blocks(errors.transpose(), weights_).row(0).dot(of(errors));
    }

private:
    void fit_beside(const Eigen::MatrixXd& declared) {
        const Eigen::Index coefficients = design_.cols(), count = declared.cols();
        const Eigen::MatrixXd in_field = estimator_ * declared;
        const Eigen::MatrixXd weighted =
            times_blocks((declared - design_ * in_field).transpose(), weights_);
        Eigen::MatrixXd normal = weighted * declared;
        normal.diagonal().array() += 1.0;
        const Eigen::MatrixXd sizes = normal.ldlt().solve(weighted);
        design_.conservativeResize(Eigen::NoChange, coefficients + count);
        design_.rightCols(count) = declared;
        estimator_ -= in_field * sizes;
        estimator_.conservativeResize(coefficients + count, Eigen::NoChange);
        estimator_.bottomRows(count) = sizes;
    }

    Eigen::MatrixXd design_, estimator_;
    std::vector<Eigen::Matrix3d> weights_;
};

// Of Q = e^T K e: what noise and declared errors in e make of it.
struct QuadraticForm {
    BlocksAndThin kernel;        // K
    BlocksAndThin spread;        // K times their covariance
    double mean = 0.0;           // for what is stated
    double variance = 0.0;       // of Q for it
    double mean_variance = 0.0;  // of the mean, as the noise is itself an estimate
};

// K (C + S S^T) for the noise's blocks C and declared errors S.
BlocksAndThin spread_by(const BlocksAndThin& kernel, std::span<const SampleNoise> noise,
                        const Eigen::MatrixXd& declared) {
    BlocksAndThin spread = kernel;
    for (std::size_t i = 0; i < noise.size(); ++i) {
        const auto k = static_cast<Eigen::Index>(3 * i);
        spread.blocks[i] = kernel.blocks[i] * noise[i].covariance;
        spread.right.middleRows<3>(k) = noise[i].covariance * kernel.right.middleRows<3>(k);
    }
    if (declared.cols() > 0) {
        spread.left.conservativeResize(Eigen::NoChange, kernel.left.cols() + declared.cols());
        spread.left.rightCols(declared.cols()) = times(kernel, declared);
        spread.right.conservativeResize(Eigen::NoChange, kernel.right.cols() + declared.cols());
        spread.right.rightCols(declared.cols()) = declared;
    }
    return spread;
}

QuadraticForm form_of(const BlocksAndThin& kernel, std::span<const SampleNoise> noise,
                      const Eigen::MatrixXd& declared) {
    QuadraticForm form{kernel, spread_by(kernel, noise, declared)};
    for (std::size_t i = 0; i < noise.size(); ++i) {
        const double share = (diagonal_block(kernel, i) * noise[i].covariance).trace();
        form.mean_variance += 2.0 * share * share / noise[i].degrees_of_freedom;
    }
    form.mean = trace(form.spread);
    form.variance = 2.0 * trace_of_product(form.spread, form.spread);
    return form;
}

// A rest that is independent from sample to sample and alike in all directions, of mean square
// length s, puts s t into |r|^2, t = trace(K) / 3. The upper end of the interval is the s with s =
// s_0 + k sigma(s).
void find_rest(const Eigen::VectorXd& residual, const QuadraticForm& form, LackOfFit& rest) {
    const double gain = trace(form.kernel) / 3.0;
    const double mean_square = std::max(0.0, (residual.squaredNorm() - form.mean) / gain);
    const double mixed = 4.0 * trace_of_product(form.spread, form.kernel) / 3.0;
    const double own = 2.0 * trace_of_product(form.kernel, form.kernel) / 9.0;
    double upper = mean_square;
    for (int round = 0; round < 100; ++round)
        upper = mean_square +
                field_coverage_factor / gain *
                    std::sqrt(form.variance + form.mean_variance + upper * (mixed + upper * own));
    rest.rms = std::sqrt(mean_square);
    rest.rms_uncertainty = std::sqrt(upper) - rest.rms;
}

}  // namespace

double chi_square_limit(double degrees_of_freedom) {
    return reduced_chi_square(limit_sigmas, degrees_of_freedom);
}

LackOfFit lack_of_fit(const BiasField& field, std::span<const FieldSample> samples,
                      std::span<const SampleNoise> noise, const Eigen::MatrixXd& declared) {
    require_usable(samples, noise, declared);
    const Residuals residuals(field, samples, declared);
    const Eigen::VectorXd errors = stacked_errors(samples);

    LackOfFit rest;
    double noise_square = 0.0;
    for (const SampleNoise& each : noise)
        noise_square += each.covariance.trace();
    rest.noise_rms = std::sqrt(noise_square / static_cast<double>(samples.size()));
    find_rest(residuals.of(errors), form_of(residuals.plain_kernel(), noise, declared), rest);

    const QuadraticForm weighted = form_of(residuals.weighted_kernel(), noise, declared);
    rest.chi_square_ratio = residuals.weighted_square(errors) / weighted.mean;
    rest.degrees_of_freedom =
        2.0 * weighted.mean * weighted.mean / (weighted.variance + weighted.mean_variance);
    rest.chi_square_limit = chi_square_limit(rest.degrees_of_freedom);
    return rest;
}

}  // namespace etalon
