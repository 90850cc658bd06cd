// Images of a straight edge under a radially symmetric point spread, from its encircled energy.
#pragma once

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

namespace etalon::test {

// Energy within a radius, px.
using EnergyWithin = std::function<double(double)>;

// Radiance at the distance t (px) into the dark side of a black-white edge: the energy beyond a
// line at the distance t, sum over rings of arccos(t / r) / pi of theirs.
inline double beyond_line(const EnergyWithin& energy, double t) {
    if (t < 0.0)
        return 1.0 - beyond_line(energy, -t);
    double sum = 0.0, r = t, within = energy(t);
    while (r < 1e5) {
        const double next = r + std::max(0.004, 0.004 * (r - t - 20.0));
        const double next_within = energy(next);
        sum += std::acos(t / (0.5 * (r + next))) * (next_within - within);
        r = next;
        within = next_within;
    }
    return sum / std::numbers::pi + 0.5 * (1.0 - within);
}

// The same averaged over pixels, at steps of 1/pitch_steps px from -half to half.
inline std::vector<double> pixel_profile(const EnergyWithin& energy, double half, int pitch_steps) {
    const int n = static_cast<int>(half * pitch_steps), pad = pitch_steps / 2;
    std::vector<double> fine;  // at the middles between steps
    for (int i = -n - pad; i < n + pad; ++i)
        fine.push_back(beyond_line(energy, (i + 0.5) / pitch_steps));
    std::vector<double> profile;
    for (int i = 0; i <= 2 * n; ++i) {
        double sum = 0.0;
        for (int q = 0; q < 2 * pad; ++q)
            sum += fine[static_cast<std::size_t>(i + q)];
        profile.push_back(sum / (2 * pad));
    }
    return profile;
}

}  // namespace etalon::test
