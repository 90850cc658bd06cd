#include "core/information.h"

#include <Eigen/Eigenvalues>

namespace etalon {

std::optional<Eigen::MatrixXd> inverse_of_information(const Eigen::MatrixXd& information,
                                                      double min_eigenvalue) {
    const Eigen::VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd scaled = scale.asDiagonal() * information * scale.asDiagonal();
    if (!scaled.allFinite())
        return std::nullopt;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(scaled);
    if (solver.info() != Eigen::Success || !(solver.eigenvalues()[0] > min_eigenvalue))
        return std::nullopt;
    const Eigen::MatrixXd roots =
        scale.asDiagonal() * solver.eigenvectors() *
        solver.eigenvalues().cwiseSqrt().cwiseInverse().asDiagonal();
    return roots * roots.transpose();
}

}  // namespace etalon
