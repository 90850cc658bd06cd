#include "sim/twin/linear_dynamics.h"

#include <fmt/format.h>

#include <cmath>

#include "core/program/errors.h"

namespace etalon {
namespace {

constexpr double scaled_norm = 0.5;
constexpr int taylor_terms = 14;  // 0.5^15 / 15! = 2e-17 of the first

// m + m^2 / 2 + m^3 / 6 + ..., by Horner.
SmallMatrix exponential_series(const SmallMatrix& m) {
    const SmallMatrix one = SmallMatrix::Identity(m.rows(), m.cols());
    SmallMatrix sum = one;
    for (int k = taylor_terms; k >= 2; --k)
        sum = one + (m * sum / k).eval();
    return m * sum;
}

}  // namespace

SmallMatrix exponential_minus_one(const SmallMatrix& m) {
    const double norm = m.cwiseAbs().rowwise().sum().maxCoeff();
    if (!std::isfinite(norm))
        throw NumericalError(fmt::format("no exponential of a matrix of norm {}", norm));
    int squarings = 0;
    std::frexp(norm / scaled_norm, &squarings);
    squarings = std::max(0, squarings);
    SmallMatrix e = exponential_series(m * std::ldexp(1.0, -squarings));
    for (int k = 0; k < squarings; ++k)
        e = (2.0 * e + e * e).eval();  // (1 + e)^2 - 1
    if (!e.allFinite())
        throw NumericalError("an exponential that overflows: the dynamics are not stable");
    return e;
}

// In units of the step: u = u_0 + u_1 s + u_2 s^2/2 + u_3 s^3/6, s from 0 to 1, is a chain of
// four states of which each is the derivative of the one before.
SmallVector LinearDynamics::advance(const SmallVector& state, const MotionPiece& piece,
                                    double seconds) const {
    const Eigen::Index n = state.size();
    const double h = seconds;
    SmallMatrix m = SmallMatrix::Zero(n + 4, n + 4);
    m.topLeftCorner(n, n) = h * a;
    m.block(0, n, n, 1) = h * b;
    for (Eigen::Index i = n; i < n + 3; ++i)
        m(i, i + 1) = 1.0;
    SmallVector whole(n + 4);
    whole << state, piece.position, h * piece.velocity, h * h * piece.acceleration,
        h * h * h * piece.jerk;
    return state + (exponential_minus_one(m) * whole).head(n);
}

}  // namespace etalon
