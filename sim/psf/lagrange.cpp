#include "sim/psf/lagrange.h"

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

double cutoff_per_px(const PointSpreadFunction& spread) {
    return spread.is_airy() ? 1.0 / spread.scale_px() : 0.836 / spread.scale_px();
}

std::vector<RadialWave> radial_transfer(const PointSpreadFunction& spread,
                                        const std::function<double(double)>& window,
                                        double reach_px, double farthest_px) {
    constexpr double two_pi = 2.0 * std::numbers::pi;
    constexpr double steps_per_scale = 40.0, followed_cutoffs = 1.25;
    const double step = spread.scale_px() / steps_per_scale;
    std::vector<double> rings;  // the energy in rings of one step, the middle of one at 0.5
    for (double r = 0.5 * step; r < reach_px; r += step)
        rings.push_back(two_pi * r * step * spread.density(r) * window(r));
    // Sixteen frequencies for each cycle that the last of them makes within the reach.
    const double end = followed_cutoffs * cutoff_per_px(spread);
    const int count = 2 * std::max(200, static_cast<int>(8.0 * end * farthest_px));
    std::vector<RadialWave> waves;
    for (int i = 0; i < count; ++i) {
        // Gauss' two places in each of count / 2 parts: the middles would leave a constant.
        const double place = i / 2 + 0.5 + (i % 2 == 0 ? -0.5 : 0.5) / std::sqrt(3.0);
        const double f = 2.0 * end * place / count;
        double transfer = 0.0;
        for (std::size_t n = 0; n < rings.size(); ++n)
            transfer += rings[n] * j0(two_pi * f * (static_cast<double>(n) + 0.5) * step);
        waves.push_back({f, transfer, end / count});
    }
    return waves;
}

double disk_transfer(double cycles) {
    const double q = 2.0 * std::numbers::pi * cycles;
    return q < 1e-6 ? 1.0 : 2.0 * j1(q) / q;
}

}  // namespace etalon
