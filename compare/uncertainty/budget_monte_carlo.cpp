#include "compare/uncertainty/budget_monte_carlo.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <numeric>

#include "compare/uncertainty/length_error.h"
#include "core/program/errors.h"
#include "core/statistics/distributions.h"
#include "core/statistics/random.h"

namespace etalon {
namespace {

constexpr int draws = 2000;
constexpr std::uint32_t stream = 1;  // summarize() draws from stream 0

// The largest length of a field at many positions, for one field after another. The range of the
// design's numbers in a box bounds it there: few boxes can hold the largest length.
class LargestLength {
public:
    LargestLength(const BiasField& field, std::vector<Eigen::Vector3d> positions)
        : field_(field), positions_(std::move(positions)), order_(positions_.size()) {
        std::iota(order_.begin(), order_.end(), 0);
        add_boxes(0, order_.size());
    }

    double of(const Eigen::VectorXd& c) const {
        std::vector<double> bounds;
        for (const Box& box : boxes_)
            bounds.push_back(bound(box, c));
        const auto first = std::ranges::max_element(bounds) - bounds.begin();
        double largest = within(boxes_[static_cast<std::size_t>(first)], c);
        for (std::size_t i = 0; i < boxes_.size(); ++i)
            if (bounds[i] > largest)
                largest = std::max(largest, within(boxes_[i], c));
        return largest;
    }

private:
    using Design = Eigen::Array<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, 15>;  // no heap
    struct Box {
        std::size_t begin, end;  // of order_
        Design low, high;        // of the design's numbers there
    };

    // Halves what is too large along its longest side.
    void add_boxes(std::size_t begin, std::size_t end) {
        constexpr std::size_t most = 256;
        if (end - begin <= most)
            return add_box(begin, end);
        Eigen::AlignedBox3d extent;
        for (std::size_t i = begin; i < end; ++i)
            extent.extend(positions_[order_[i]]);
        Eigen::Index axis = 0;
        extent.sizes().maxCoeff(&axis);
        const auto at = [&](std::size_t i) {
            return order_.begin() + static_cast<std::ptrdiff_t>(i);
        };
        const std::size_t middle = begin + (end - begin) / 2;
        std::nth_element(at(begin), at(middle), at(end), [&](std::uint32_t a, std::uint32_t b) {
            return positions_[a][axis] < positions_[b][axis];
        });
        add_boxes(begin, middle);
        add_boxes(middle, end);
    }

    void add_box(std::size_t begin, std::size_t end) {
        const Design first = field_.design(positions_[order_[begin]]);
        Box& box = boxes_.emplace_back(Box{begin, end, first, first});
        for (std::size_t i = begin; i < end; ++i) {
            const Design design = field_.design(positions_[order_[i]]);
            box.low = box.low.min(design);
            box.high = box.high.max(design);
        }
    }

    // Not below any length in the box, rounding included.
    static double bound(const Box& box, const Eigen::VectorXd& c) {
        constexpr double rounding = 1.0 + 1e-9;
        const Design a = box.low.rowwise() * c.transpose().array(),
                     b = box.high.rowwise() * c.transpose().array();
        const Eigen::Array3d low = a.min(b).rowwise().sum(), high = a.max(b).rowwise().sum();
        return rounding * low.abs().max(high.abs()).matrix().norm();
    }

    double within(const Box& box, const Eigen::VectorXd& c) const {
        double largest = 0.0;
        for (std::size_t i = box.begin; i < box.end; ++i) {
            const Eigen::MatrixXd design = field_.design(positions_[order_[i]]);
            Eigen::Array3d v = Eigen::Array3d::Zero();
            for (Eigen::Index k = 0; k < c.size(); ++k)
                v += design.col(k).array() * c[k];
            const Eigen::Array3d s = v.square();
            // Which squares are added first decides the last bit: old reports stay as they are.
            const double sum = order_[i] % 2 == 0 ? (s[0] + s[1]) + s[2] : (s[1] + s[2]) + s[0];
            largest = std::max(largest, std::sqrt(sum));
        }
        return largest;
    }

    const BiasField& field_;
    std::vector<Eigen::Vector3d> positions_;
    std::vector<std::uint32_t> order_;  // of positions_, box by box
    std::vector<Box> boxes_;
};

// What the figures of a field are taken from, as matrices on its coefficients.
class FieldFigures {
public:
    FieldFigures(const BiasField& field, std::span<const FieldSample> samples,
                 std::span<const Eigen::Vector3d> positions)
        : lengthening_(samples),
          design_(stacked_design(field, samples)),
          power_(mean_power(field, positions)),
          noise_power_(power_.cwiseProduct(field.covariance).sum()),
          largest_(field, hull_positions(positions)) {}

    // Coefficients that carry noise `times` over: each puts its power into the square.
    double rms(const Eigen::VectorXd& c, double times) const {
        return std::sqrt(std::max(0.0, c.dot(power_ * c) - times * noise_power_));
    }
    double max(const Eigen::VectorXd& c) const { return largest_.of(c); }

    // For each column of coefficients. The rows of so many pairs are made for so many columns.
    Eigen::VectorXd length_max(const Eigen::MatrixXd& coefficients,
                               const std::stop_token& stop) const {
        constexpr std::size_t columns_at_a_time = 64;
        Eigen::VectorXd largest = Eigen::VectorXd::Zero(coefficients.cols());
        tbb::parallel_for(
            tbb::blocked_range<Eigen::Index>(0, coefficients.cols(), columns_at_a_time),
            [&](const auto& columns) {
                const Eigen::Index pairs = lengthening_.size();
                for (Eigen::Index first = 0; first < pairs; first += pairs_at_a_time) {
                    throw_if_stopped(stop);
                    const Eigen::MatrixXd rows =
                        lengthening_.of(design_, first, std::min(pairs_at_a_time, pairs - first));
                    for (Eigen::Index i = columns.begin(); i < columns.end(); ++i)
                        largest[i] = std::max(largest[i],
                                              (rows * coefficients.col(i)).cwiseAbs().maxCoeff());
                }
            });
        return largest;
    }

private:
    PairLengthening lengthening_;
    Eigen::MatrixXd design_, power_;
    double noise_power_;
    LargestLength largest_;
};

// The coefficients' change in one draw. The square root of degrees of freedom over chi-square makes
// normal deviates those of Student's distribution.
Eigen::VectorXd drawn(RandomStream& random, const Eigen::MatrixXd& ways, Distribution distribution,
                      double degrees_of_freedom) {
    double scale = 1.0;
    if (std::isfinite(degrees_of_freedom))
        scale /= std::sqrt(std::max(1e-3, reduced_chi_square(random.normal(), degrees_of_freedom)));
    Eigen::VectorXd amplitude(ways.cols());
    for (double& value : amplitude)
        value = scale * (distribution == Distribution::uniform
                             ? std::numbers::sqrt3 * (2.0 * random.uniform() - 1.0)
                             : random.normal());
    return ways * amplitude;
}

double quantile(std::vector<double>& values) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(coverage_probability * draws);
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

}  // namespace

MonteCarloUncertainty monte_carlo_uncertainty(const BiasField& field,
                                              std::span<const FieldSample> samples,
                                              std::span<const Eigen::Vector3d> positions_mm,
                                              std::span<const FieldInput> inputs,
                                              std::uint64_t seed, const std::stop_token& stop) {
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
    Eigen::MatrixXd drawn_fields(field.coefficients.size(), draws + 1);
    drawn_fields.col(draws) = field.coefficients;
    std::vector<double> rms(draws), max(draws);
    tbb::parallel_for(0, draws, [&](int draw) {
        throw_if_stopped(stop);
        RandomStream random(seed, stream, static_cast<std::uint64_t>(draw));
        Eigen::VectorXd c = field.coefficients +
                            drawn(random, noise, Distribution::normal, field.degrees_of_freedom);
        for (std::size_t i = 0; i < ways.size(); ++i)
            c += drawn(random, ways[i], inputs[i].distribution, inputs[i].degrees_of_freedom);
        rms[static_cast<std::size_t>(draw)] = figures.rms(c, 2.0);
        max[static_cast<std::size_t>(draw)] = figures.max(c);
        drawn_fields.col(draw) = c;
    });
    const Eigen::VectorXd lengths = figures.length_max(drawn_fields, stop);
    std::vector<double> length(lengths.begin(), lengths.end() - 1);
    const auto beyond = [](std::vector<double>& values, double value) {
        return std::max(0.0, quantile(values) - value);
    };
    return {beyond(rms, figures.rms(field.coefficients, 1.0)),
            beyond(max, figures.max(field.coefficients)), beyond(length, lengths[draws])};
}

}  // namespace etalon
