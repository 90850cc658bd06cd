// The covariance of what was fitted: the inverse of an information matrix, J^T J in units of noise.
#pragma once

#include <Eigen/Core>
#include <optional>

namespace etalon {

// By eigenvalues, scaled to a unit diagonal, so that rad and mm compare. Nothing for an eigenvalue
// of that (mean 1) not above `min_eigenvalue`, or what is not finite.
std::optional<Eigen::MatrixXd> covariance_from_information(const Eigen::MatrixXd& information,
                                                           double min_eigenvalue = 1e-12);

// How much more errors scatter than a covariance says: a factor of it, as a matrix in units in
// which it is the identity. `effects`: a column for each of n independent groups, what its
// residuals did to the parameters in those units: S, the sum of x x^T, is the sandwich estimate
// (Liang and Zeger, Biometrika 73, 1986). S is drawn towards a multiple of the identity by its own
// scatter between groups (Ledoit and Wolf, J. Multivariate Analysis 88, 2004): the mean of its
// eigenvalues, one at least.
Eigen::MatrixXd cluster_robust_factor(const Eigen::MatrixXd& effects);

}  // namespace etalon
