#include "core/statistics/covariance.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

namespace etalon {

std::optional<Eigen::MatrixXd> covariance_from_information(const Eigen::MatrixXd& information,
                                                           double min_eigenvalue) {
    const Eigen::VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
    if (!scaled.allFinite())
        return std::nullopt;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled);
    if (solver.info() != Eigen::Success || !(solver.eigenvalues()[0] > min_eigenvalue))
        return std::nullopt;
    const Eigen::MatrixXd roots = scale.asDiagonal() * solver.eigenvectors() *
                                  solver.eigenvalues().cwiseSqrt().cwiseInverse().asDiagonal();
    return roots * roots.transpose();
}

// n x x^T scatters about S, and its mean square distance from it over n is how wrong S itself is.
Eigen::MatrixXd cluster_robust_factor(const Eigen::MatrixXd& effects) {
    const double n = static_cast<double>(effects.cols());
    const Eigen::MatrixXd s = effects * effects.transpose(),
                          identity = Eigen::MatrixXd::Identity(effects.rows(), effects.rows());
    const double mean = s.trace() / static_cast<double>(effects.rows());
    const double distance = (s - mean * identity).squaredNorm();
    double error = 0.0;
    for (Eigen::Index i = 0; i < effects.cols(); ++i)
        error += (n * effects.col(i) * effects.col(i).transpose() - s).squaredNorm() / (n * n);
    const double drawn = error < distance ? error / distance : 1.0;
    return std::max(mean, 1.0) * (drawn * identity + (mean > 0.0 ? (1.0 - drawn) / mean : 0.0) * s);
}

}  // namespace etalon
