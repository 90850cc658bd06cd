#include "compare/uncertainty/length_error.h"

#include <fmt/format.h>

#include <cmath>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double min_distance_mm = 1e-6;

struct Pair {
    Eigen::Index i = 1, k = 0;  // k < i
};

// Pairs (1, 0), (2, 0), (2, 1), (3, 0), ...
Pair pair_at(Eigen::Index number) {
    auto i =
        static_cast<Eigen::Index>((1.0 + std::sqrt(1.0 + 8.0 * static_cast<double>(number))) / 2.0);
    while (i * (i - 1) / 2 > number)
        --i;
    while ((i + 1) * i / 2 <= number)
        ++i;
    return {i, number - i * (i - 1) / 2};
}

// Of the single pairs, exactly and not to first order.
void summarize_pairs(std::span<const FieldSample> samples, LengthErrors& result) {
    double squares = 0.0;
    for (std::size_t i = 0; i < samples.size(); ++i)
        for (std::size_t k = 0; k < i; ++k) {
            const Eigen::Vector3d way = samples[i].position_mm - samples[k].position_mm;
            const double error = (way + samples[i].error - samples[k].error).norm() - way.norm();
            squares += error * error;
            result.longest_mm = std::max(result.longest_mm, way.norm());
            result.measured_max_mm = std::max(result.measured_max_mm, std::abs(error));
        }
    result.measured_rms_mm = std::sqrt(squares / static_cast<double>(result.pairs));
}

}  // namespace

PairLengthening::PairLengthening(std::span<const FieldSample> samples)
    : n_(static_cast<Eigen::Index>(samples.size())) {
    if (n_ < 2)
        throw NumericalError(fmt::format("length error: {} positions make no pair", n_));
    for (const FieldSample& sample : samples)
        positions_.push_back(sample.position_mm);
}

double PairLengthening::distance_mm(Eigen::Index pair) const {
    const auto [i, k] = pair_at(pair);
    return (positions_[static_cast<std::size_t>(i)] - positions_[static_cast<std::size_t>(k)])
        .norm();
}

Eigen::MatrixXd PairLengthening::of(const Eigen::MatrixXd& shifts, Eigen::Index first,
                                    Eigen::Index count) const {
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(count, shifts.cols());
    for (Eigen::Index row = 0; row < count; ++row) {
        const auto [i, k] = pair_at(first + row);
        const Eigen::Vector3d way =
            positions_[static_cast<std::size_t>(i)] - positions_[static_cast<std::size_t>(k)];
        const double distance = way.norm();
        // Repeated poses are no length.
        if (!(distance > min_distance_mm))
            continue;
        for (Eigen::Index axis = 0; axis < 3; ++axis)
            rows.row(row) -= way[axis] / distance * shifts.row(3 * k + axis);
        for (Eigen::Index axis = 0; axis < 3; ++axis)
            rows.row(row) += way[axis] / distance * shifts.row(3 * i + axis);
    }
    return rows;
}

PairLengthening::Largest PairLengthening::largest(const Eigen::MatrixXd& shifts) const {
    Largest result;
    for (Eigen::Index first = 0; first < size(); first += pairs_at_a_time) {
        const Eigen::Index count = std::min(pairs_at_a_time, size() - first);
        Eigen::Index at = 0;
        const double largest = of(shifts, first, count).rowwise().norm().maxCoeff(&at);
        if (largest > result.lengthening)
            result = {largest, first + at};
    }
    return result;
}

LengthErrors length_errors(const BiasField& field, std::span<const FieldSample> samples,
                           const NoiseDraws& draws) {
    const PairLengthening lengthening(samples);
    const Eigen::MatrixXd design = stacked_design(field, samples);
    LengthErrors result;
    result.pairs = static_cast<int>(lengthening.size());
    summarize_pairs(samples, result);
    const auto [lengthened, pair] = lengthening.largest(design * field.coefficients);
    result.field_max_mm = lengthened;
    result.field_max_length_mm = lengthening.distance_mm(pair);
    result.field_max_uncertainty_mm = noise_quantile(
        field, draws, {lengthening.size(), 1, [&](Eigen::Index first, Eigen::Index count) {
                           return lengthening.of(design, first, count);
                       }});
    return result;
}

}  // namespace etalon
