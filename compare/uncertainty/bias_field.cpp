#include "compare/uncertainty/bias_field.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "compare/uncertainty/uncertainty_budget.h"
#include "core/program/errors.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

constexpr double length_mm = 100.0;  // makes the basis functions comparable
constexpr int min_samples = 10;
constexpr double coverage = 0.977;  // one-sided, of that factor
constexpr int draw_count = 2000;
constexpr int max_coefficients = 15;
constexpr double huber_sigmas = 3.0;
constexpr double min_scale = 1e-9;  // of exact data: keeps the weights finite

// One scalar observation: a sample's error along one direction.
struct Rows {
    Eigen::MatrixXd design;  // per row in units of the sample's sigma
    Eigen::VectorXd value;   // the same
    Eigen::VectorXd sigma;   // to get back to the error's unit

    static bool is_along(Eigen::Index row) { return row % 3 == 0; }
};

bool has_value_at(FieldBasis basis, const Eigen::Vector3d& position_mm) {
    return position_mm.allFinite() &&
           (basis == FieldBasis::position ? position_mm.z() > 0.0 : position_mm.norm() > 0.0);
}

void require_usable(std::span<const FieldSample> samples, FieldBasis basis) {
    if (samples.size() < min_samples)
        throw NumericalError(fmt::format("smooth field: {} samples, at least {} are needed",
                                         samples.size(), min_samples));
    for (const FieldSample& sample : samples) {
        const bool finite = sample.error.allFinite() && std::isfinite(sample.sigma_along) &&
                            std::isfinite(sample.sigma_across);
        if (!finite || !has_value_at(basis, sample.position_mm) || sample.sigma_along <= 0.0 ||
            sample.sigma_across <= 0.0 || !(std::abs(sample.axis.norm() - 1.0) < 1e-6))
            throw NumericalError(
                "smooth field: a sample is not finite, behind the camera or without a noise level");
    }
}

Rows rows_of(const BiasField& field, std::span<const FieldSample> samples) {
    const auto columns = field.design(samples.front().position_mm).cols();
    const auto count = static_cast<Eigen::Index>(3 * samples.size());
    Rows rows{Eigen::MatrixXd(count, columns), Eigen::VectorXd(count), Eigen::VectorXd(count)};
    Eigen::Index r = 0;
    for (const FieldSample& sample : samples) {
        const Eigen::MatrixXd design = field.design(sample.position_mm);
        const Eigen::Vector3d across = sample.axis.unitOrthogonal();
        const Eigen::Vector3d directions[] = {sample.axis, across, sample.axis.cross(across)};
        for (int k = 0; k < 3; ++k, ++r) {
            rows.sigma[r] = k == 0 ? sample.sigma_along : sample.sigma_across;
            rows.design.row(r) = directions[k].transpose() * design / rows.sigma[r];
            rows.value[r] = directions[k].dot(sample.error) / rows.sigma[r];
        }
    }
    return rows;
}

double scale_of(const BiasField& field, bool along) {
    return along ? field.scale_along : field.scale_across;
}

// Weighted least squares at the field's present scales; `weight` is per row, Huber's included.
void solve(BiasField& field, const Rows& rows, const Eigen::VectorXd& weight) {
    const Eigen::VectorXd root = weight.cwiseSqrt();
    const Eigen::MatrixXd a = root.asDiagonal() * rows.design;
    const Eigen::VectorXd unscale = a.colwise().norm().cwiseInverse();
    if (!unscale.allFinite())
        throw NumericalError("smooth field: the samples do not span the volume");
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> solver(a * unscale.asDiagonal());
    const auto pivots = solver.matrixQR().diagonal().cwiseAbs();
    if (!(pivots.minCoeff() > 1e-5 * pivots.maxCoeff()))
        throw NumericalError(fmt::format(
            "smooth field: the samples do not span the volume (condition number about {:.2g})",
            pivots.maxCoeff() / pivots.minCoeff()));
    field.coefficients =
        unscale.cwiseProduct(solver.solve(Eigen::VectorXd(root.cwiseProduct(rows.value))));
    const Eigen::Index columns = a.cols();
    Eigen::MatrixXd inverse = Eigen::MatrixXd::Identity(columns, columns);
    solver.matrixQR().topRows(columns).triangularView<Eigen::Upper>().solveInPlace(inverse);
    inverse = unscale.asDiagonal() * (solver.colsPermutation() * inverse);
    field.covariance = inverse * inverse.transpose();
}

// Variance of each of the two groups from its residuals, with the part of the degrees of freedom
// that the fit took from it (Helmert's variance components, simplified).
void estimate_scales(BiasField& field, const Rows& rows, const Eigen::VectorXd& weight,
                     const Eigen::VectorXd& residual) {
    const Eigen::MatrixXd spread = rows.design * field.covariance;
    const Eigen::VectorXd leverage =
        spread.cwiseProduct(rows.design).rowwise().sum().cwiseProduct(weight);
    for (const bool along : {true, false}) {
        double sum = 0.0, plain = 0.0, freedom = 0.0;
        for (Eigen::Index r = 0; r < residual.size(); ++r) {
            if (Rows::is_along(r) != along)
                continue;
            const double huber = weight[r] * std::pow(scale_of(field, along), 2);
            sum += huber * residual[r] * residual[r];
            plain += std::pow(residual[r] * rows.sigma[r], 2);
            freedom += 1.0 - leverage[r];
        }
        (along ? field.scale_along : field.scale_across) =
            std::max(std::sqrt(sum / freedom), min_scale);
        (along ? field.residual_along : field.residual_across) = std::sqrt(plain / freedom);
    }
}

Eigen::VectorXd weights(BiasField& field, const Eigen::VectorXd& residual) {
    Eigen::VectorXd weight(residual.size());
    field.down_weighted = 0;
    for (Eigen::Index r = 0; r < residual.size(); ++r) {
        const double scale = scale_of(field, Rows::is_along(r));
        const double length = std::abs(residual[r]) / scale;
        weight[r] = std::min(1.0, huber_sigmas / std::max(length, 1e-300)) / (scale * scale);
        field.down_weighted += length > huber_sigmas ? 1 : 0;
    }
    return weight;
}

// The last three columns, at p and q = p - centre in units of length_mm.
Eigen::Matrix3d by_tangent(const Eigen::Vector3d& p, const Eigen::Vector3d& q) {
    const double rho2 = p.head<2>().squaredNorm() / (p.z() * p.z());
    Eigen::Matrix3d columns = Eigen::Matrix3d::Zero();
    columns.col(0) << p.x() * rho2, p.y() * rho2, 0.0;
    columns(2, 1) = p.z() * rho2;
    columns(2, 2) = q.z() * q.z();
    return columns;
}

Eigen::Matrix3d by_angle(const Eigen::Vector3d& p, const Eigen::Vector3d& centre) {
    const double aside = p.head<2>().norm(), distance = p.norm(), theta = std::atan2(aside, p.z());
    Eigen::Matrix3d columns = Eigen::Matrix3d::Zero();
    if (aside > 0.0)
        columns.col(0) << p.head<2>() * (p.z() / aside), -aside;
    columns.col(0) *= std::pow(theta, 3);
    columns.col(1) = p * theta * theta;
    columns.col(2) = p / distance * std::pow(distance - centre.norm(), 2);
    return columns;
}

Eigen::MatrixXd basis_at(const BiasField& field, const Eigen::Vector3d& position_mm) {
    const bool full = field.basis != FieldBasis::linear;
    Eigen::MatrixXd b = Eigen::MatrixXd::Zero(3, full ? max_coefficients : 12);
    const Eigen::Vector3d q = (position_mm - field.centre_mm) / length_mm;
    b.leftCols<3>().setIdentity();
    for (int k = 0; k < 3; ++k)
        b.block<3, 3>(0, 3 + 3 * k) = q[k] * Eigen::Matrix3d::Identity();
    if (full) {
        const Eigen::Vector3d p = position_mm / length_mm;
        b.rightCols<3>() = field.basis == FieldBasis::position
                               ? by_tangent(p, q)
                               : by_angle(p, Eigen::Vector3d(field.centre_mm / length_mm));
    }
    return b;
}

// Positions in a plane leave some of the columns 0, or sums of others.
Eigen::MatrixXd determined_combinations(const Eigen::MatrixXd& columns) {
    constexpr double least = 1e-5;  // of the largest, with columns of one length
    constexpr double rounding = 1e-9;
    const Eigen::VectorXd lengths = columns.colwise().norm();
    const double negligible = rounding * lengths.maxCoeff();
    const Eigen::VectorXd unscale =
        (lengths.array() > negligible).select(lengths.cwiseInverse(), 0.0);
    const Eigen::BDCSVD<Eigen::MatrixXd> parts(columns * unscale.asDiagonal(), Eigen::ComputeThinV);
    const Eigen::Index rank =
        (parts.singularValues().array() > least * parts.singularValues()[0]).count();
    if (rank == columns.cols())
        return {};
    return unscale.asDiagonal() * parts.matrixV().leftCols(rank);
}

}  // namespace

Eigen::MatrixXd BiasField::design(const Eigen::Vector3d& position_mm) const {
    const Eigen::MatrixXd basis_columns = basis_at(*this, position_mm);
    return is_full() ? basis_columns : Eigen::MatrixXd(basis_columns * combinations);
}

Eigen::Vector3d BiasField::at(const Eigen::Vector3d& position_mm) const {
    return design(position_mm) * coefficients;
}

FieldBasis position_basis(const LensProjection& projection) {
    return projection.is_flat() ? FieldBasis::position : FieldBasis::position_by_angle;
}

BiasField fit_smooth_field(std::span<const FieldSample> samples, FieldBasis basis) {
    require_usable(samples, basis);
    BiasField field;
    field.basis = basis;
    field.samples = static_cast<int>(samples.size());
    for (const FieldSample& sample : samples)
        field.centre_mm += sample.position_mm / static_cast<double>(samples.size());
    Rows rows = rows_of(field, samples);
    field.combinations = determined_combinations(rows.design);
    if (!field.is_full())
        rows.design *= field.combinations;
    field.degrees_of_freedom = static_cast<int>(rows.design.rows() - rows.design.cols());
    field.scale_along = field.scale_across = 1.0;
    Eigen::VectorXd weight = Eigen::VectorXd::Ones(rows.value.size());
    for (int round = 0; round < 8; ++round) {
        solve(field, rows, weight);
        const Eigen::VectorXd residual = rows.value - rows.design * field.coefficients;
        estimate_scales(field, rows, weight, residual);
        weight = weights(field, residual);
    }
    solve(field, rows, weight);
    if (!field.coefficients.allFinite() || !field.covariance.allFinite())
        throw NumericalError("smooth field: the fit gave a value that is not finite");
    return field;
}

Eigen::MatrixXd stacked_design(const BiasField& field, std::span<const FieldSample> samples) {
    Eigen::MatrixXd stacked(3 * std::ssize(samples), field.coefficients.size());
    for (std::size_t i = 0; i < samples.size(); ++i)
        stacked.middleRows<3>(static_cast<Eigen::Index>(3 * i)) =
            field.design(samples[i].position_mm);
    return stacked;
}

std::vector<Eigen::Matrix3d> sample_weights(const BiasField& field,
                                            std::span<const FieldSample> samples) {
    std::vector<Eigen::Matrix3d> weights;
    for (const FieldSample& sample : samples) {
        const Eigen::Matrix3d along = sample.axis * sample.axis.transpose();
        weights.push_back(along * std::pow(field.scale_along * sample.sigma_along, -2) +
                          (Eigen::Matrix3d::Identity() - along) *
                              std::pow(field.scale_across * sample.sigma_across, -2));
    }
    return weights;
}

Eigen::MatrixXd times_blocks(const Eigen::MatrixXd& left, std::span<const Eigen::Matrix3d> blocks) {
    if (left.cols() != 3 * std::ssize(blocks))
        throw NumericalError(
            fmt::format("smooth field: {} columns for {} blocks of 3", left.cols(), blocks.size()));
    Eigen::MatrixXd product(left.rows(), left.cols());
    for (std::size_t i = 0; i < blocks.size(); ++i) {
        const auto k = static_cast<Eigen::Index>(3 * i);
        product.middleCols<3>(k).noalias() = left.middleCols<3>(k) * blocks[i];
    }
    return product;
}

Eigen::MatrixXd estimator(const BiasField& field, std::span<const FieldSample> samples) {
    const Eigen::MatrixXd design = stacked_design(field, samples);
    const Eigen::MatrixXd weighted =
        times_blocks(design.transpose(), sample_weights(field, samples));
    const Eigen::MatrixXd normal = weighted * design;
    // Columns to equal length: the coefficients' sizes differ by much.
    const Eigen::VectorXd unscale = normal.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd scaled = unscale.asDiagonal() * normal * unscale.asDiagonal();
    return unscale.asDiagonal() *
           scaled.ldlt().solve(Eigen::MatrixXd(unscale.asDiagonal() * weighted));
}

Eigen::MatrixXd covariance_factor(const BiasField& field) {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(field.covariance);
    return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
}

Eigen::MatrixXd mean_power(const BiasField& field, std::span<const Eigen::Vector3d> positions_mm) {
    const Eigen::Index coefficients = field.coefficients.size();
    Eigen::MatrixXd power = Eigen::MatrixXd::Zero(coefficients, coefficients);
    for (const Eigen::Vector3d& position : positions_mm) {
        const Eigen::MatrixXd design = field.design(position);
        power += design.transpose() * design / static_cast<double>(positions_mm.size());
    }
    return power;
}

NoiseDraws::NoiseDraws(std::uint64_t seed) : deviates(max_coefficients, draw_count) {
    for (int i = 0; i < draw_count; ++i) {
        RandomStream random(seed, 0, static_cast<std::uint64_t>(i));
        for (double& value : deviates.col(i))
            value = random.normal();
    }
}

namespace {

double coverage_quantile(Eigen::VectorXd values) {
    const auto quantile = values.begin() + static_cast<std::ptrdiff_t>(coverage * draw_count);
    std::nth_element(values.begin(), quantile, values.end());
    return *quantile;
}

// Vectors as they are linear in normal deviates, those that can be longest first. None is longer
// than its bound (the norm of its rows) times the deviates' norm.
class LongestFirst {
public:
    LongestFirst(const LinearVectors& vectors, const Eigen::MatrixXd& factor)
        : vectors_(vectors), factor_(factor) {
        constexpr Eigen::Index at_a_time = 1024;
        for (Eigen::Index first = 0; first < vectors.size; first += at_a_time) {
            const Eigen::Index count = std::min(at_a_time, vectors.size - first);
            const Eigen::MatrixXd rows = vectors.rows(first, count) * factor;
            for (Eigen::Index i = 0; i < count; ++i)
                order_.emplace_back(
                    -rows.middleRows(i * vectors.components, vectors.components).norm(), first + i);
        }
        std::ranges::sort(order_);
    }

    double bound(Eigen::Index i) const { return -order_[static_cast<std::size_t>(i)].first; }

    // Of `count` vectors from the `first` on, for each column of deviates.
    Eigen::RowVectorXd largest(Eigen::Index first, Eigen::Index count,
                               const Eigen::MatrixXd& deviates) const {
        const int components = vectors_.components;
        Eigen::MatrixXd rows(count * components, factor_.rows());
        for (Eigen::Index i = 0; i < count; ++i)
            rows.middleRows(i * components, components) =
                vectors_.rows(order_[static_cast<std::size_t>(first + i)].second, 1);
        const Eigen::MatrixXd all = rows * factor_ * deviates;
        const Eigen::RowVectorXd squares =
            all.reshaped(components, count * deviates.cols()).colwise().squaredNorm();
        return squares.reshaped(count, deviates.cols()).colwise().maxCoeff().cwiseSqrt();
    }

private:
    const LinearVectors& vectors_;
    const Eigen::MatrixXd& factor_;
    std::vector<std::pair<double, Eigen::Index>> order_;  // by minus the bound
};

}  // namespace

double noise_quantile(const BiasField& field, const NoiseDraws& draws,
                      const LinearVectors& vectors) {
    constexpr Eigen::Index block = 64;
    const Eigen::MatrixXd factor = covariance_factor(field);
    const LongestFirst longest_first(vectors, factor);
    const Eigen::MatrixXd deviates = draws.deviates.topRows(factor.cols());
    const Eigen::VectorXd norms = deviates.colwise().norm();
    Eigen::VectorXd largest = Eigen::VectorXd::Zero(draw_count);
    for (Eigen::Index first = 0; first < vectors.size; first += block) {
        // A draw below what is the quantile already is looked at again where it may get above.
        const double reached = coverage_quantile(largest);
        std::vector<Eigen::Index> open;
        for (Eigen::Index i = 0; i < draw_count; ++i)
            if (longest_first.bound(first) * norms[i] > std::max(reached, largest[i]))
                open.push_back(i);
        if (open.empty())
            break;
        const Eigen::Index count = std::min(block, vectors.size - first);
        largest(open) = largest(open).cwiseMax(
            longest_first.largest(first, count, deviates(Eigen::all, open)).transpose());
    }
    return coverage_quantile(largest);
}

namespace {

// The field's power P = c^T M c has, for a true RMS of R, the variance 4 R^2 l + t: l is the
// largest variance of a unit field's amplitude and t what noise alone does. The upper end of the
// interval is the R with R^2 = rms^2 + k sqrt(4 R^2 l + t).
void summarize_rms(const BiasField& field, std::span<const Eigen::Vector3d> positions,
                   FieldSummary& summary) {
    const Eigen::MatrixXd factor = covariance_factor(field), power = mean_power(field, positions);
    const Eigen::VectorXd noise = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(
                                      Eigen::MatrixXd(factor.transpose() * power * factor))
                                      .eigenvalues()
                                      .cwiseMax(0.0);
    const double square = field.coefficients.dot(power * field.coefficients) - noise.sum();
    const double rms2 = std::max(0.0, square);
    const double k2 = field_coverage_factor * field_coverage_factor;
    const double b = rms2 + 2.0 * k2 * noise.maxCoeff();
    const double upper2 = b + std::sqrt(b * b - rms2 * rms2 + k2 * 2.0 * noise.squaredNorm());
    summary.rms = std::sqrt(rms2);
    summary.rms_uncertainty = std::sqrt(upper2) - summary.rms;
    summary.noise_rms = std::sqrt(noise.sum());
}

}  // namespace

FieldSummary summarize(const BiasField& field, std::span<const Eigen::Vector3d> positions_mm,
                       const NoiseDraws& draws) {
    if (positions_mm.empty())
        throw NumericalError("smooth field: no positions to evaluate it at");
    for (const Eigen::Vector3d& position : positions_mm)
        if (!has_value_at(field.basis, position))
            throw NumericalError("smooth field: a position is not finite or behind the camera");
    FieldSummary summary;
    summarize_rms(field, positions_mm, summary);
    for (const Eigen::Vector3d& position : hull_positions(positions_mm)) {
        const double length = field.at(position).norm();
        if (length >= summary.max) {
            summary.max = length;
            summary.max_position_mm = position;
        }
    }
    const auto designs = [&](Eigen::Index first, Eigen::Index count) {
        Eigen::MatrixXd rows(3 * count, field.coefficients.size());
        for (Eigen::Index i = 0; i < count; ++i)
            rows.middleRows<3>(3 * i) =
                field.design(positions_mm[static_cast<std::size_t>(first + i)]);
        return rows;
    };
    summary.max_uncertainty = noise_quantile(field, draws, {std::ssize(positions_mm), 3, designs});
    return summary;
}

std::vector<Eigen::Vector3d> hull_positions(std::span<const Eigen::Vector3d> positions_mm) {
    std::vector<Eigen::Vector3d> positions(positions_mm.begin(), positions_mm.end());
    for (std::size_t i = 0; i < positions_mm.size(); ++i)
        for (std::size_t k = 0; k < i; ++k)
            positions.push_back(0.5 * (positions_mm[i] + positions_mm[k]));
    return positions;
}

}  // namespace etalon
