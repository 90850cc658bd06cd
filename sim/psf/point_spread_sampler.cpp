#include "sim/psf/point_spread_sampler.h"

#include <math.h>  // j0, j1: POSIX, not in namespace std

#include <cmath>

#include "sim/psf/diffraction.h"

namespace etalon {
namespace {

using std::numbers::pi;

constexpr double airy_step = 0.01;   // of the table, in x = pi r / (lambda N_w)
constexpr double table_end = 400.0;  // beyond, the mean over the rings: 0.1 % of 0.16 % is lost
constexpr int guides = 4096;
constexpr double core_energy = 0.95, core_share = 0.75;
constexpr int parts_of_interval = 256;  // of a profile

}  // namespace

PointSpreadSampler::PointSpreadSampler(const CameraModel& camera)
    : kind_(camera.lens->psf.kind), scale_px_(camera.lens->psf.sigma_px) {
    if (kind_ == PointSpread::Kind::gaussian)
        return;
    if (kind_ == PointSpread::Kind::measured) {
        tabulate_profile(camera.lens->psf.profile);
    } else {
        scale_px_ = lambda_n_px(camera);
        const int count = static_cast<int>(table_end / airy_step) + 1;
        for (int i = 0; i < count; ++i) {
            const double x = i * airy_step, a = ::j0(x), b = ::j1(x);
            // Encircled energy never falls; rounding must not make it.
            const double energy = 1.0 - a * a - b * b;
            energy_.push_back(std::max(energy, energy_.empty() ? 0.0 : energy_.back()));
        }
    }
    for (int g = 0; g < guides; ++g) {
        const auto above = std::upper_bound(energy_.begin(), energy_.end(), g / double(guides));
        guide_.push_back(std::max(0, static_cast<int>(above - energy_.begin()) - 1));
    }
}

// Simpson's rule, exact for radius times a straight line.
void PointSpreadSampler::tabulate_profile(const std::vector<std::pair<double, double>>& profile) {
    radius_ = {0.0};
    energy_ = {0.0};
    for (std::size_t i = 0; i + 1 < profile.size(); ++i) {
        const double a = profile[i].first, da = profile[i].second;
        const double b = profile[i + 1].first, db = profile[i + 1].second;
        const auto value = [&](double t) { return (a + t * (b - a)) * (da + t * (db - da)); };
        for (int n = 0; n < parts_of_interval; ++n) {
            const double from = n / double(parts_of_interval), to = (n + 1.0) / parts_of_interval;
            const double mean = (value(from) + 4.0 * value(0.5 * (from + to)) + value(to)) / 6.0;
            radius_.push_back(a + to * (b - a));
            energy_.push_back(energy_.back() + mean * (to - from) * (b - a));
        }
    }
    const double whole = energy_.back();
    for (double& energy : energy_)
        energy /= whole;
}

PointSpreadSampler::Position PointSpreadSampler::position_of(double energy) const {
    auto i = static_cast<std::size_t>(guide_[static_cast<std::size_t>(energy * guides)]);
    while (energy_[i + 1] <= energy)
        ++i;
    return {i, (energy - energy_[i]) / (energy_[i + 1] - energy_[i])};
}

double PointSpreadSampler::radius_of(double energy) const {
    if (kind_ == PointSpread::Kind::gaussian)
        return scale_px_ * std::sqrt(-2.0 * std::log1p(-energy));
    if (kind_ == PointSpread::Kind::measured) {
        const auto [i, part] = position_of(energy);
        const double a = radius_[i], b = radius_[i + 1];
        return std::sqrt(a * a + part * (b * b - a * a));
    }
    if (energy >= energy_.back())  // J0^2 + J1^2 -> 2 / (pi x)
        return 2.0 / (pi * (1.0 - energy)) * scale_px_ / pi;
    const auto [i, part] = position_of(energy);
    // The first interval begins like a parabola.
    const double x = (static_cast<double>(i) + (i == 0 ? std::sqrt(part) : part)) * airy_step;
    return x * scale_px_ / pi;
}

PointSpreadSampler::Energy PointSpreadSampler::energy(double u) {
    if (u < core_share)
        return {u / core_share * core_energy, core_energy / core_share};
    const double part = (u - core_share) / (1.0 - core_share);
    return {core_energy + part * (1.0 - core_energy), (1.0 - core_energy) / (1.0 - core_share)};
}

}  // namespace etalon
