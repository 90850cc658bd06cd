// The 6-point Lagrange kernel: the weight that a sample at distance t (in sample steps) has in the
// quintic interpolant through six equally spaced samples. Symmetric, 1 at 0, 0 at all other
// integers and beyond 3. And the cubic through four.
#pragma once

namespace etalon {

double lagrange6(double t);

// Its integral from a to b.
double lagrange6_integral(double a, double b);

// At t, through values at -1, 0, 1 and 2.
double cubic_through(const double* v, double t);

}  // namespace etalon
