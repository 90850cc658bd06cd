// Linear dynamics x' = A x + b u(t), advanced without discretisation error: within one piece of a
// motion u is a cubic of time, and the state after it is one matrix exponential of A beside the
// chain of u's derivatives (Van Loan, "Computing integrals involving the matrix exponential", IEEE
// Trans. Automatic Control 23, 1978). Stable systems stay stable for every step, however stiff.
//
// The exponential is by scaling and squaring of exp(M) - 1 rather than of exp(M): a slow part
// beside a fast one would be lost in the 1 (6 of 16 digits at time constants 1 : 1 000 000).
#pragma once

#include <Eigen/Core>

#include "sim/twin/motion_profile.h"

namespace etalon {

// Small and without memory of the heap: at most 12 rows.
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 12, 12>;
using SmallVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 12, 1>;

// exp(m) - 1 of a square matrix, finite, whose exponential does not overflow (else NumericalError).
// States should be scaled so that the entries of a row are as large as the rate of its state.
SmallMatrix exponential_minus_one(const SmallMatrix& m);

struct LinearDynamics {
    SmallMatrix a;  // 1/s; n x n, n at most 8
    SmallVector b;  // 1/s; n

    // The state `seconds` >= 0 after `state`, with u(s) the position of `piece` at s. About 10 us.
    SmallVector advance(const SmallVector& state, const MotionPiece& piece, double seconds) const;
};

}  // namespace etalon
