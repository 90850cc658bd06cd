#include "compare/drift/drift_rate.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/statistics/distributions.h"

namespace etalon {
namespace {

// The least-squares line of one or more quantities over time.
struct Lines {
    Eigen::Matrix4Xd residuals;
    Movement slope;
    double time_squares = 0.0;  // sum of (t - mean)^2, min^2
};

Lines fit_lines(std::span<const DriftBlock> blocks) {
    const auto n = static_cast<Eigen::Index>(blocks.size());
    Eigen::VectorXd times(n);
    Eigen::Matrix4Xd values(4, n);
    for (Eigen::Index i = 0; i < n; ++i) {
        times[i] = blocks[static_cast<std::size_t>(i)].time.count();
        values.col(i) = blocks[static_cast<std::size_t>(i)].movement;
    }
    times.array() -= times.mean();
    const Movement mean = values.rowwise().mean();
    values.colwise() -= mean;
    Lines lines;
    lines.time_squares = times.squaredNorm();
    lines.slope = values * times / lines.time_squares;
    lines.residuals = values - lines.slope * times.transpose();
    return lines;
}

double correlation_of_neighbours(const Eigen::Matrix4Xd& residuals) {
    const double squares = residuals.squaredNorm();
    if (squares == 0.0)
        return 0.0;
    const Eigen::Index n = residuals.cols();
    const double products =
        residuals.leftCols(n - 1).cwiseProduct(residuals.rightCols(n - 1)).sum();
    return std::max(0.0, products / squares);
}

// Slope of a point's residuals; nothing where less than half of the blocks have the point.
std::optional<Eigen::Vector2d> residual_slope(std::span<const DriftBlock> blocks, int id) {
    std::vector<std::pair<double, Eigen::Vector2d>> rows;
    for (const DriftBlock& block : blocks)
        if (const auto at = block.residuals.find(id); at != block.residuals.end())
            rows.emplace_back(block.time.count(), at->second);
    if (2 * rows.size() < blocks.size())
        return std::nullopt;
    double middle = 0.0;
    for (const auto& [time, residual] : rows)
        middle += time / static_cast<double>(rows.size());
    double squares = 0.0;
    Eigen::Vector2d products = Eigen::Vector2d::Zero();
    for (const auto& [time, residual] : rows) {
        squares += (time - middle) * (time - middle);
        products += (time - middle) * residual;
    }
    return squares > 0.0 ? std::optional<Eigen::Vector2d>(products / squares) : std::nullopt;
}

double shape_drift(std::span<const DriftBlock> blocks, const TargetPoints& points) {
    double squares = 0.0;
    int count = 0;
    for (const auto& [id, pixel] : points)
        if (const auto slope = residual_slope(blocks, id)) {
            squares += slope->squaredNorm();
            ++count;
        }
    // Two points' worth of freedom went into the movement.
    return count > 2 ? std::sqrt(squares / (count - 2)) : 0.0;
}

// Standard deviation in the direction in which it is largest.
double largest_deviation(const Eigen::Matrix2d& covariance) {
    return std::sqrt(std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(
                                       Eigen::MatrixXd(covariance), Eigen::EigenvaluesOnly)
                                       .eigenvalues()[1]));
}

void find_worst(DriftRate& rate, const Eigen::Matrix4d& covariance,
                const TargetReference& reference, cv::Size image) {
    rate.worst_px_per_min = -1.0;
    for (const double x : {-0.5, image.width - 0.5})
        for (const double y : {-0.5, image.height - 0.5}) {
            const auto at = reference.at({x, y});
            const double drift = (at * rate.per_min).norm();
            const double u = largest_deviation(at * covariance * at.transpose());
            rate.bound_px_per_min =
                std::max(rate.bound_px_per_min, drift + rate.coverage_factor * u);
            if (drift > rate.worst_px_per_min) {
                rate.worst_px_per_min = drift;
                rate.worst_pixel = {x, y};
                rate.standard_uncertainty_px_per_min = u;
            }
        }
    rate.expanded_uncertainty_px_per_min =
        rate.coverage_factor * rate.standard_uncertainty_px_per_min;
}

}  // namespace

std::optional<DriftRate> estimate_drift(std::span<const DriftBlock> blocks,
                                        const TargetReference& reference, cv::Size image,
                                        double chance_of_error) {
    if (blocks.size() < min_blocks || !(blocks.back().time > blocks.front().time))
        return std::nullopt;
    const Lines lines = fit_lines(blocks);
    const auto freedoms = static_cast<int>(blocks.size()) - 2;
    DriftRate rate;
    rate.from = blocks.front().time;
    rate.to = blocks.back().time;
    rate.per_min = lines.slope;
    rate.block_correlation = correlation_of_neighbours(lines.residuals);
    const double widening = (1.0 + rate.block_correlation) / (1.0 - rate.block_correlation);
    const Eigen::Matrix4d covariance =
        widening / (freedoms * lines.time_squares) * lines.residuals * lines.residuals.transpose();
    rate.standard_uncertainty = covariance.diagonal().cwiseSqrt();
    rate.coverage_factor = student_t_quantile(chance_of_error, freedoms);
    find_worst(rate, covariance, reference, image);
    rate.shape_px_per_min = shape_drift(blocks, reference.points());
    return rate;
}

}  // namespace etalon
