#include "core/optimize/least_squares.h"

#include <Eigen/QR>
#include <cmath>

namespace etalon {
namespace {

double length_of_group(const ResidualsAndJacobian& at, Eigen::Index row,
                       const LeastSquaresRule& rule) {
    return at.residuals.segment(row, rule.group).norm();
}

// Rows beyond the threshold shortened to where their squares stand in for Huber's function.
void weigh(ResidualsAndJacobian& at, const LeastSquaresRule& rule) {
    for (Eigen::Index row = 0; row < at.residuals.size(); row += rule.group) {
        const double length = length_of_group(at, row, rule);
        if (length <= rule.huber)
            continue;
        const double weight = std::sqrt(rule.huber / length);
        at.residuals.segment(row, rule.group) *= weight;
        at.jacobian.middleRows(row, rule.group) *= weight;
    }
}

}  // namespace

double robust_loss(const ResidualsAndJacobian& at, const LeastSquaresRule& rule) {
    double loss = 0.0;
    for (Eigen::Index row = 0; row < at.residuals.size(); row += rule.group) {
        const double length = length_of_group(at, row, rule);
        loss +=
            length <= rule.huber ? 0.5 * length * length : rule.huber * (length - 0.5 * rule.huber);
    }
    return loss;
}

DampedStep damped_step(ResidualsAndJacobian at, double damping, const LeastSquaresRule& rule) {
    weigh(at, rule);
    const Eigen::Index rows = at.jacobian.rows(), columns = at.jacobian.cols();
    const Eigen::VectorXd scale =
        at.jacobian.colwise().norm().transpose().cwiseMax(std::numeric_limits<double>::min());
    Eigen::MatrixXd stack(rows + columns, columns);
    stack << at.jacobian * scale.cwiseInverse().asDiagonal(),
        std::sqrt(damping) * Eigen::MatrixXd::Identity(columns, columns);
    Eigen::VectorXd values = Eigen::VectorXd::Zero(rows + columns);
    values.head(rows) = -at.residuals;
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(stack);
    const Eigen::VectorXd scaled = qr.solve(values);
    // What the linear model loses: |r|^2 / 2 less |r + J s|^2 / 2, without their difference.
    const double gain =
        0.5 * (stack.topRows(rows) * scaled).squaredNorm() + damping * scaled.squaredNorm();
    return {scaled.cwiseQuotient(scale), gain};
}

}  // namespace etalon
