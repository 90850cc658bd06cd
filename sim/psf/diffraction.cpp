#include "sim/psf/diffraction.h"

#include <fmt/format.h>
#include <math.h>  // j1: POSIX, not in namespace std

#include <cmath>

#include "core/program/errors.h"

namespace etalon {

using std::numbers::pi;

double lambda_n_px(const CameraModel& camera) {
    const double n_w = working_f_number(camera);
    return camera.lens->wavelength_nm * 1e-3 * n_w / camera.sensor->pixel_pitch_um;
}

namespace {

double checked(const char* what, double px) {
    if (!(px > 0.0) || !std::isfinite(px))
        throw NumericalError(fmt::format("no {} = {} px", what, px));
    return px;
}

void check_profile(const std::vector<std::pair<double, double>>& profile) {
    if (profile.size() < 4)
        throw NumericalError("a measured point spread needs at least 4 radii");
    bool is_dark = true;
    for (std::size_t i = 0; i < profile.size(); ++i) {
        const auto [r, density] = profile[i];
        const bool rises = i == 0 ? r == 0.0 : r > profile[i - 1].first;
        if (!rises || !std::isfinite(r) || !(density >= 0.0) || !std::isfinite(density))
            throw NumericalError(fmt::format(
                "a measured point spread cannot have density {} at radius {} px", density, r));
        is_dark = is_dark && density == 0.0;
    }
    if (is_dark)
        throw NumericalError("a measured point spread needs some energy");
}

// Energy of the ring from a to b with the density d at a and this slope: the integral of
// 2 pi s (d + slope (s - a)) ds.
double ring_energy(double a, double b, double d, double slope) {
    const double h = b - a;
    return 2.0 * pi * h * (d * (a + h / 2.0) + slope * h * (a / 2.0 + h / 3.0));
}

}  // namespace

PointSpreadFunction PointSpreadFunction::airy(double lambda_n_px) {
    return {Kind::airy, checked("Airy pattern has lambda N", lambda_n_px)};
}

PointSpreadFunction PointSpreadFunction::gaussian(double sigma_px) {
    return {Kind::gaussian, checked("Gaussian has sigma", sigma_px)};
}

PointSpreadFunction PointSpreadFunction::measured(
    const std::vector<std::pair<double, double>>& profile) {
    check_profile(profile);
    PointSpreadFunction psf(Kind::measured, profile.back().first);
    double energy = 0.0;
    for (std::size_t i = 0; i + 1 < profile.size(); ++i) {
        const auto [a, d] = profile[i];
        const auto [b, next] = profile[i + 1];
        const double slope = (next - d) / (b - a);
        psf.rings_.push_back({a, energy, d, slope});
        energy += ring_energy(a, b, d, slope);
        psf.scale_px_ = std::min(psf.scale_px_, b - a);
    }
    psf.rings_.push_back({profile.back().first, energy, 0.0, 0.0});
    if (!std::isfinite(energy) || !(energy > 0.0))
        throw NumericalError("a measured point spread's energy overflows or vanishes");
    for (Ring& ring : psf.rings_) {
        ring.energy /= energy;
        ring.density /= energy;
        ring.slope /= energy;
    }
    return psf;
}

PointSpreadFunction PointSpreadFunction::of(const CameraModel& camera) {
    const double scale_px = etalon::lambda_n_px(camera);
    switch (camera.lens->psf.kind) {
        case PointSpread::Kind::gaussian:
            return gaussian(camera.lens->psf.sigma_px);
        case PointSpread::Kind::measured:
            return measured(camera.lens->psf.profile);
        case PointSpread::Kind::wave:
            throw NumericalError(
                "psf wave: the wave-optical pattern depends on defocus and has no single filter");
        default:
            return airy(scale_px);
    }
}

// The ring that holds r >= 0.
const PointSpreadFunction::Ring& PointSpreadFunction::ring_at(double r) const {
    const auto after = std::upper_bound(rings_.begin(), rings_.end(), r,
                                        [](double a, const Ring& b) { return a < b.r; });
    return *(after - 1);
}

double PointSpreadFunction::density(double r) const {
    if (kind_ == Kind::gaussian) {
        const double q = r / scale_px_;
        return std::exp(-0.5 * q * q) / (2.0 * pi * scale_px_ * scale_px_);
    }
    if (kind_ == Kind::measured) {
        const Ring& ring = ring_at(r);
        return ring.density + ring.slope * (r - ring.r);
    }
    const double x = pi * r / scale_px_;
    if (x < 1e-4)  // J1(x) / x = 1/2 - x^2/16 + ...
        return pi / (4.0 * scale_px_ * scale_px_) * (1.0 - x * x / 4.0);
    const double bessel = ::j1(x);
    return bessel * bessel / (pi * r * r);
}

double PointSpreadFunction::ring_average_density(double r) const {
    return scale_px_ / (pi * pi * pi * r * r * r);
}

double PointSpreadFunction::energy_within(double r) const {
    if (kind_ == Kind::gaussian) {
        const double q = r / scale_px_;
        return -std::expm1(-0.5 * q * q);
    }
    if (kind_ == Kind::measured) {
        const Ring& ring = ring_at(r);
        return ring.energy + ring_energy(ring.r, r, ring.density, ring.slope);
    }
    const double x = pi * r / scale_px_, a = ::j0(x), b = ::j1(x);
    return 1.0 - a * a - b * b;
}

double PointSpreadFunction::radius_of_tail(double energy) const {
    if (kind_ == Kind::gaussian)
        return scale_px_ * std::sqrt(-2.0 * std::log(energy));
    if (kind_ == Kind::airy)
        return 2.0 * scale_px_ / (pi * pi * energy);
    double within = 0.0, beyond = rings_.back().r;
    for (int i = 0; i < 60; ++i) {
        const double r = 0.5 * (within + beyond);
        (1.0 - energy_within(r) > energy ? within : beyond) = r;
    }
    return beyond;
}

}  // namespace etalon
