#include "compare/verdict/length_error.h"

#include <fmt/format.h>

#include <cmath>

#include "core/errors.h"

namespace etalon {
namespace {

constexpr double min_distance_mm = 1e-6;

Eigen::VectorXd pair_distances(std::span<const FieldSample> samples) {
    const auto n = static_cast<Eigen::Index>(samples.size());
    Eigen::VectorXd distances(n * (n - 1) / 2);
    Eigen::Index row = 0;
    for (std::size_t i = 0; i < samples.size(); ++i)
        for (std::size_t k = 0; k < i; ++k)
            distances[row++] = (samples[i].position_mm - samples[k].position_mm).norm();
    return distances;
}

// Exactly, not to first order.
Eigen::VectorXd measured_errors(std::span<const FieldSample> samples) {
    Eigen::VectorXd errors = -pair_distances(samples);
    Eigen::Index row = 0;
    for (std::size_t i = 0; i < samples.size(); ++i)
        for (std::size_t k = 0; k < i; ++k)
            errors[row++] += (samples[i].position_mm + samples[i].error - samples[k].position_mm -
                              samples[k].error)
                                 .norm();
    return errors;
}

}  // namespace

PairLengthening pair_lengthening(std::span<const FieldSample> samples) {
    const auto n = static_cast<Eigen::Index>(samples.size());
    if (n < 2)
        throw NumericalError(fmt::format("length error: {} positions make no pair", n));
    PairLengthening rows(n * (n - 1) / 2, 3 * n);
    rows.reserve(Eigen::VectorXi::Constant(rows.rows(), 6));
    Eigen::Index row = 0;
    for (Eigen::Index i = 0; i < n; ++i)
        for (Eigen::Index k = 0; k < i; ++k, ++row) {
            const Eigen::Vector3d way = samples[static_cast<std::size_t>(i)].position_mm -
                                        samples[static_cast<std::size_t>(k)].position_mm;
            // Repeated poses are no length.
            if (!(way.norm() > min_distance_mm))
                continue;
            for (Eigen::Index axis = 0; axis < 3; ++axis) {
                rows.insert(row, 3 * k + axis) = -way[axis] / way.norm();
                rows.insert(row, 3 * i + axis) = way[axis] / way.norm();
            }
        }
    return rows;
}

LengthErrors length_errors(const SmoothField& field, std::span<const FieldSample> samples,
                           const NoiseDraws& draws) {
    const Eigen::MatrixXd lengthening = pair_lengthening(samples) * stacked_design(field, samples);
    const Eigen::VectorXd distances = pair_distances(samples);
    const Eigen::VectorXd measured = measured_errors(samples);
    LengthErrors result;
    result.pairs = static_cast<int>(distances.size());
    result.longest_mm = distances.maxCoeff();
    result.measured_rms_mm = measured.norm() / std::sqrt(static_cast<double>(measured.size()));
    result.measured_max_mm = measured.cwiseAbs().maxCoeff();
    Eigen::Index worst = 0;
    result.field_max_mm = (lengthening * field.coefficients).cwiseAbs().maxCoeff(&worst);
    result.field_max_length_mm = distances[worst];
    result.field_max_uncertainty_mm = noise_quantile(field, draws, lengthening, 1);
    return result;
}

}  // namespace etalon
