#include "sim/psf/lagrange.h"

#include <algorithm>
#include <cmath>

namespace etalon {

double lagrange6(double t) {
    t = std::abs(t);
    if (t < 1.0)
        return (1 - t * t) * (4 - t * t) * (3 - t) / 12;
    if (t < 2.0)
        return (t * t - 1) * (t - 2) * (3 - t) * (4 - t) / 24;
    if (t < 3.0)
        return (t - 1) * (t - 2) * (3 - t) * (4 - t) * (5 - t) / 120;
    return 0.0;
}

// 3-point Gauss is exact for the kernel's quintic pieces.
double lagrange6_integral(double a, double b) {
    a = std::clamp(a, -3.0, 3.0);
    b = std::clamp(b, -3.0, 3.0);
    double sum = 0.0;
    for (double from = a; from < b;) {
        const double to = std::min(b, std::floor(from) + 1.0);
        const double centre = 0.5 * (from + to), half = 0.5 * (to - from);
        const double node = half * std::sqrt(0.6);
        sum += half / 9.0 *
               (5.0 * lagrange6(centre - node) + 8.0 * lagrange6(centre) +
                5.0 * lagrange6(centre + node));
        from = to;
    }
    return sum;
}

double cubic_through(const double* v, double t) {
    return -v[0] * t * (t - 1) * (t - 2) / 6 + v[1] * (t + 1) * (t - 1) * (t - 2) / 2 -
           v[2] * (t + 1) * t * (t - 2) / 2 + v[3] * (t + 1) * t * (t - 1) / 6;
}

}  // namespace etalon
