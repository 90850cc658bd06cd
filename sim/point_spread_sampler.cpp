#include "sim/point_spread_sampler.h"

#include <math.h>  // j0, j1: POSIX, not in namespace std

#include <algorithm>
#include <cmath>
#include <numbers>

namespace etalon {
namespace {

using std::numbers::pi;

constexpr double step = 0.01;        // of the table, in x = pi r / (lambda N_w)
constexpr double table_end = 400.0;  // beyond, the mean over the rings: 0.1 % of 0.16 % is lost
constexpr int guides = 4096;
constexpr double core_energy = 0.95, core_share = 0.75;

}  // namespace

PointSpreadSampler::PointSpreadSampler(const CameraModel& camera)
    : is_airy_(camera.lens->psf.kind == PointSpread::Kind::ideal) {
    if (!is_airy_) {
        scale_px_ = camera.lens->psf.sigma_px;
        return;
    }
    scale_px_ = camera.lens->wavelength_nm * 1e-3 * thin_lens(camera).working_f_number /
                camera.sensor->pixel_pitch_um;
    const int count = static_cast<int>(table_end / step) + 1;
    for (int i = 0; i < count; ++i) {
        const double x = i * step, a = ::j0(x), b = ::j1(x);
        // Encircled energy never falls; rounding must not make it.
        const double energy = 1.0 - a * a - b * b;
        energy_.push_back(std::max(energy, energy_.empty() ? 0.0 : energy_.back()));
    }
    for (int g = 0; g < guides; ++g) {
        const auto above = std::upper_bound(energy_.begin(), energy_.end(), g / double(guides));
        guide_.push_back(std::max(0, static_cast<int>(above - energy_.begin()) - 1));
    }
}

double PointSpreadSampler::radius_of(double energy) const {
    if (!is_airy_)
        return scale_px_ * std::sqrt(-2.0 * std::log1p(-energy));
    double x;
    if (energy >= energy_.back()) {
        x = 2.0 / (pi * (1.0 - energy));  // J0^2 + J1^2 -> 2 / (pi x)
    } else {
        auto i = static_cast<std::size_t>(guide_[static_cast<std::size_t>(energy * guides)]);
        while (energy_[i + 1] <= energy)
            ++i;
        const double part = (energy - energy_[i]) / (energy_[i + 1] - energy_[i]);
        // The first interval begins like a parabola.
        x = (static_cast<double>(i) + (i == 0 ? std::sqrt(part) : part)) * step;
    }
    return x * scale_px_ / pi;
}

PointSpreadSampler::Radius PointSpreadSampler::radius(double u) const {
    if (u < core_share)
        return {radius_of(u / core_share * core_energy), core_energy / core_share};
    const double part = (u - core_share) / (1.0 - core_share);
    return {radius_of(core_energy + part * (1.0 - core_energy)),
            (1.0 - core_energy) / (1.0 - core_share)};
}

}  // namespace etalon
