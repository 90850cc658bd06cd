// The inverse of an information matrix, J^T J in units of the noise: the covariance of what was
// fitted.
#pragma once

#include <Eigen/Core>
#include <optional>

namespace etalon {

// By eigenvalues, with rows and columns scaled to a unit diagonal first, so that rad and mm compare.
// Nothing where a direction is not told about: an eigenvalue of the scaled matrix (their mean is 1)
// that is not above `min_eigenvalue`, or what is not finite.
std::optional<Eigen::MatrixXd> inverse_of_information(const Eigen::MatrixXd& information,
                                                      double min_eigenvalue = 1e-12);

}  // namespace etalon
