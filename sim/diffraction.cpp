#include "sim/diffraction.h"

#include <math.h>  // j1: POSIX, not in namespace std

#include <cmath>
#include <numbers>

#include "core/errors.h"

namespace etalon {

using std::numbers::pi;

PointSpreadFunction PointSpreadFunction::airy(double lambda_n_px) {
    if (!(lambda_n_px > 0.0) || !std::isfinite(lambda_n_px))
        throw NumericalError(fmt::format("no Airy pattern has lambda N = {} px", lambda_n_px));
    return {true, lambda_n_px};
}

PointSpreadFunction PointSpreadFunction::gaussian(double sigma_px) {
    if (!(sigma_px > 0.0) || !std::isfinite(sigma_px))
        throw NumericalError(fmt::format("no Gaussian has sigma = {} px", sigma_px));
    return {false, sigma_px};
}

PointSpreadFunction PointSpreadFunction::of(const CameraModel& camera) {
    const ThinLens lens = thin_lens(camera);
    if (camera.lens->psf.kind == PointSpread::Kind::gaussian)
        return gaussian(camera.lens->psf.sigma_px);
    const double lambda_um = camera.lens->wavelength_nm * 1e-3;
    return airy(lambda_um * lens.working_f_number / camera.sensor->pixel_pitch_um);
}

double PointSpreadFunction::density(double r) const {
    if (!is_airy_) {
        const double q = r / scale_px_;
        return std::exp(-0.5 * q * q) / (2.0 * pi * scale_px_ * scale_px_);
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
    if (!is_airy_) {
        const double q = r / scale_px_;
        return -std::expm1(-0.5 * q * q);
    }
    const double x = pi * r / scale_px_, a = ::j0(x), b = ::j1(x);
    return 1.0 - a * a - b * b;
}

double PointSpreadFunction::radius_of_tail(double energy) const {
    if (!is_airy_)
        return scale_px_ * std::sqrt(-2.0 * std::log(energy));
    return 2.0 * scale_px_ / (pi * pi * energy);
}

}  // namespace etalon
