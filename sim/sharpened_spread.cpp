#include "sim/sharpened_spread.h"

#include <cmath>
#include <numbers>

namespace etalon {
namespace {

constexpr double two_pi = 2.0 * std::numbers::pi;
constexpr double disk_phase_at_cutoff = 2.6;
constexpr double followed_cutoffs = 1.25;
constexpr double least_scale_px = 0.04;
constexpr double steps_per_scale = 40.0;

// Of a Gaussian the part beyond is below 1e-6.
double cutoff(const PointSpreadFunction& spread) {
    return spread.is_airy() ? 1.0 / spread.scale_px() : 0.836 / spread.scale_px();
}

double disk_transfer(double radius_px, double f) {
    const double q = two_pi * radius_px * f;
    return q < 1e-6 ? 1.0 : 2.0 * j1(q) / q;
}

}  // namespace

std::optional<SharpenedSpread> SharpenedSpread::of(const PointSpreadFunction& spread,
                                                   const std::function<double(double)>& window,
                                                   double reach_px) {
    if (!spread.has_cutoff() || spread.scale_px() < least_scale_px)
        return std::nullopt;
    SharpenedSpread result;
    result.disk_radius_px_ = disk_phase_at_cutoff / (two_pi * cutoff(spread));
    result.reach_px_ = reach_px + 4.0 * result.disk_radius_px_;
    result.table_step_px_ = spread.scale_px() / steps_per_scale;

    const double step = result.table_step_px_;
    std::vector<double> rings;  // the core's energy in rings of one step, the middle of one at 0.5
    for (double r = 0.5 * step; r < reach_px; r += step)
        rings.push_back(two_pi * r * step * spread.density(r) * window(r));
    // Sixteen frequencies for each cycle that the last of them makes within the reach.
    const double end = followed_cutoffs * cutoff(spread);
    const int count = 2 * std::max(200, static_cast<int>(8.0 * end * result.reach_px_));
    for (int i = 0; i < count; ++i) {
        // Gauss' two places in each of count / 2 parts: the middles would leave a constant.
        const double place = i / 2 + 0.5 + (i % 2 == 0 ? -0.5 : 0.5) / std::sqrt(3.0);
        const double f = 2.0 * end * place / count;
        double transfer = 0.0;
        for (std::size_t n = 0; n < rings.size(); ++n)
            transfer += rings[n] * j0(two_pi * f * (static_cast<double>(n) + 0.5) * step);
        const double left = transfer / disk_transfer(result.disk_radius_px_, f);
        result.waves_.push_back({f, left * end / count});
    }
    const int steps = static_cast<int>(result.reach_px_ / step) + 4;
    for (int n = -1; n < steps; ++n) {
        double sum = 0.0;
        for (const Wave& wave : result.waves_)
            sum += wave.amplitude * wave.cycles_per_px * j0(two_pi * wave.cycles_per_px * n * step);
        result.table_.push_back(two_pi * sum);
    }
    return result;
}

// Cubic interpolation of the table.
double SharpenedSpread::density(double r) const {
    const double place = r / table_step_px_;
    const auto n = static_cast<std::size_t>(place);
    if (n + 3 >= table_.size())
        return 0.0;
    const double t = place - static_cast<double>(n);
    const double* v = &table_[n];
    return -v[0] * t * (t - 1) * (t - 2) / 6 + v[1] * (t + 1) * (t - 1) * (t - 2) / 2 -
           v[2] * (t + 1) * t * (t - 2) / 2 + v[3] * (t + 1) * t * (t - 1) / 6;
}

// The transfer along one axis is a section of the plane's.
double SharpenedSpread::line(double x) const {
    double sum = 0.0;
    for (const Wave& wave : waves_)
        sum += wave.amplitude * std::cos(two_pi * wave.cycles_per_px * x);
    return 2.0 * sum;
}

}  // namespace etalon
