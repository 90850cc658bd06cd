// The 6-point Lagrange kernel: the weight that a sample at distance t (in sample steps) has in the
// quintic interpolant through six equally spaced samples. Symmetric, 1 at 0, 0 at all other
// integers and beyond 3. And the cubic through four.
#pragma once

#include <functional>

#include "sim/psf/diffraction.h"

namespace etalon {

double lagrange6(double t);

// Its integral from a to b.
double lagrange6_integral(double a, double b);

// At t, through values at -1, 0, 1 and 2.
double cubic_through(const double* v, double t);

// What a round pattern passes of each spatial frequency: its Hankel transform.

// One node of a quadrature over the frequencies.
struct RadialWave {
    double cycles_per_px, transfer;
    double width;  // of the node, cycles per px
};

// The frequency beyond which the spread leaves (almost) nothing; of a Gaussian 1e-6.
double cutoff_per_px(const PointSpreadFunction& spread);

// Of spread density times window, a function of the radius that ends at `reach_px`, to 1.25 times
// the cut-off; nodes for functions that reach `farthest_px`. 10 to 30 ms.
std::vector<RadialWave> radial_transfer(const PointSpreadFunction& spread,
                                        const std::function<double(double)>& window,
                                        double reach_px, double farthest_px);

// Of a disk, evenly lit, at this radius times the frequency: 1 at 0.
double disk_transfer(double cycles);

}  // namespace etalon
