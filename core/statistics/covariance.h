// The inverse of an information matrix, J^T J in units of the noise: the covariance of what was
// fitted.
#pragma once

#include <Eigen/Core>
#include <optional>

namespace etalon {

// By eigenvalues, with rows and columns scaled to a unit diagonal first, so that rad and mm
// compare. Nothing where a direction is not told about: an eigenvalue of the scaled matrix (their
// mean is 1) that is not above `min_eigenvalue`, or what is not finite.
std::optional<Eigen::MatrixXd> covariance_from_information(const Eigen::MatrixXd& information,
                                                           double min_eigenvalue = 1e-12);

// How much more errors scatter than the noise that a covariance was made of says: a factor of that
// covariance, as a matrix in units in which it is the identity. `effects` has a column for each of
// n independent groups (views, parts of a picture): what its residuals did to the parameters, in
// those units, so that S, the sum of x x^T, is the sandwich estimate (Liang and Zeger, Biometrika
// 73, 1986). S is drawn towards a multiple of the identity by as much as its own scatter from group
// to group says (Ledoit and Wolf, J. Multivariate Analysis 88, 2004); the multiple is the mean of
// its eigenvalues, one at least.
Eigen::MatrixXd excess_scatter(const Eigen::MatrixXd& effects);

}  // namespace etalon
