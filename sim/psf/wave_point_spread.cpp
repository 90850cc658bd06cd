#include "sim/psf/wave_point_spread.h"

#include <fmt/format.h>
#include <math.h>  // j0, j1: POSIX, not in namespace std

#include <cmath>
#include <complex>

#include "core/program/errors.h"
#include "sim/psf/lagrange.h"

namespace etalon {
namespace {

using std::numbers::pi;

constexpr double max_u = 1000.0;
constexpr double wave_step = 0.05;  // of the table, in v; |U|^2 has no period below pi

// Sums of q^n J_n(v) over even and odd n with alternating signs, q <= 1:
//     even = J0 - q^2 J2 + q^4 J4 ...,   odd = q J1 - q^3 J3 ...
struct LommelSums {
    double even, odd;
};

// Miller's downward recurrence J_{n-1} = (2n/v) J_n - J_{n+1} from beyond the last order that
// matters, normalised by J0 + 2 J2 + 2 J4 + ... = 1; the powers of q by Horner's rule.
LommelSums lommel_sums(double v, double q) {
    if (v < 1e-6)
        return {1.0, 0.5 * q * v};
    int n = 2 * static_cast<int>(0.5 * (v + 12.0 * std::cbrt(v)) + 12.0);  // even
    double above = 0.0, here = 1e-280;
    double whole = 0.0, even = 0.0, odd = 0.0;
    const double q2 = q * q;
    for (; n >= 2; n -= 2) {  // here = J_n, above = J_{n+1}
        whole += 2.0 * here;
        even = here - q2 * even;
        const double below = 2.0 * n / v * here - above;  // J_{n-1}
        odd = below - q2 * odd;
        above = below;
        here = 2.0 * (n - 1) / v * below - here;  // J_{n-2}
        if (std::abs(here) > 1e200) {
            for (double* value : {&above, &here, &whole, &even, &odd})
                *value *= 1e-200;
        }
    }
    whole += here;
    even = here - q2 * even;
    return {even / whole, q * odd / whole};
}

// Gauss-Legendre in t = rho^2 with 5 points, exact to rounding where the integrand hardly turns.
double intensity_near_focus(double u, double v) {
    constexpr std::array<double, 5> t{0.046910077030668, 0.2307653449471585, 0.5,
                                      0.7692346550528415, 0.953089922969332};
    constexpr std::array<double, 5> weight{0.1184634425280945, 0.2393143352496832,
                                           0.2844444444444444, 0.2393143352496832,
                                           0.1184634425280945};
    std::complex<double> amplitude = 0.0;
    for (std::size_t i = 0; i < t.size(); ++i)
        amplitude += std::polar(weight[i] * ::j0(v * std::sqrt(t[i])), 0.5 * u * t[i]);
    return std::norm(amplitude);
}

// (1 - energy within v) = 2/pi of this, on average over the rings.
double tail_shape(double u, double v) {
    return v / (v * v - u * u);
}

// The mean over the rings, well outside the disk (r > R).
double ring_density(double lambda_n_px, double blur_radius_px, double r) {
    const double q2 = blur_radius_px * blur_radius_px / (r * r);
    return lambda_n_px / (pi * pi * pi * r * r * r) * (1.0 + q2) / ((1.0 - q2) * (1.0 - q2));
}

// The core ends smoothly between these distances from the geometrical disk, in units of ring_px_.
constexpr double fall_from = 3.0, fall_to = 6.0;

// What a box average at 0 contributes to a pixel centred at x: the pixel is the mean of k averages,
// each interpolated between the boxes.
double pixel_response(int k, double x) {
    double sum = 0.0;
    for (int i = 0; i < k; ++i)
        sum += lagrange6(k * x - (i - (k - 1) * 0.5));
    return sum / k;
}

// Midpoint nodes from -half to half (px along x) against `count` samples at steps of 1/k pixels of
// this pitch.
struct Nodes {
    Eigen::VectorXd position;
    Eigen::MatrixXd response;  // nodes x samples
};

Nodes nodes(double half, double step, double pitch, int k, int count) {
    const int n = 2 * static_cast<int>(std::ceil(half / step));
    Nodes result{Eigen::VectorXd(n), Eigen::MatrixXd(n, count)};
    for (int i = 0; i < n; ++i) {
        result.position[i] = (i + 0.5 - 0.5 * n) * step;
        for (int j = 0; j < count; ++j)
            result.response(i, j) =
                pixel_response(k, result.position[i] / pitch - (j - 0.5 * (count - 1)) / k);
    }
    return result;
}

}  // namespace

double wave_intensity(double u, double v) {
    if (u < 0.1 && v < 0.1)
        return intensity_near_focus(u, v);
    if (u < 1e-9) {
        const double amplitude = 2.0 * ::j1(v) / v;
        return amplitude * amplitude;
    }
    if (v >= u) {
        const LommelSums sums = lommel_sums(v, u / v);  // U1 = odd, U2 = J0 - even
        const double u1 = sums.odd, u2 = ::j0(v) - sums.even;
        return 4.0 * (u1 * u1 + u2 * u2) / (u * u);
    }
    const LommelSums sums = lommel_sums(v, v / u);  // V0 = even, V1 = odd
    const double phase = 0.5 * (u + v * v / u);
    const double sum = 1.0 + sums.even * sums.even + sums.odd * sums.odd -
                       2.0 * sums.even * std::cos(phase) - 2.0 * sums.odd * std::sin(phase);
    return std::max(0.0, 4.0 * sum / (u * u));
}

WavePointSpread::WavePointSpread(double lambda_n_px, double blur_radius_px)
    : scale_(pi / lambda_n_px), blur_radius_px_(blur_radius_px), u_(scale_ * blur_radius_px) {
    if (!(lambda_n_px > 0.0 && std::isfinite(lambda_n_px) && blur_radius_px >= 0.0 && u_ <= max_u))
        throw NumericalError(
            fmt::format("psf wave: no pattern for the blur radius {:.6g} px with lambda N = {:.6g} "
                        "px: their ratio must be within 0..{:.0f}",
                        blur_radius_px, lambda_n_px, max_u / pi));
    const int rows = static_cast<int>((1.5 * u_ + 200.0) / wave_step) + 1;
    for (int i = 0; i <= rows; ++i)  // one more than is used
        intensity_.push_back(wave_intensity(u_, i * wave_step));
    // f = v |U|^2 / 2 is the energy per v; the integral of the cubic through four values.
    const auto f = [&](int i) {
        return 0.5 * i * wave_step * intensity_[std::size_t(std::abs(i))];
    };
    energy_.push_back(0.0);
    for (int i = 0; i + 1 < rows; ++i)
        energy_.push_back(energy_.back() +
                          wave_step / 24.0 * (13.0 * (f(i) + f(i + 1)) - f(i - 1) - f(i + 2)));
    const double end = static_cast<double>(energy_.size() - 1) * wave_step;
    closing_ = (1.0 - energy_.back()) / (2.0 / pi * tail_shape(u_, end));
}

double WavePointSpread::table_end_px() const {
    return static_cast<double>(energy_.size() - 1) * wave_step / scale_;
}

double WavePointSpread::density(double r) const {
    const double place = scale_ * r / wave_step;
    const auto i = static_cast<std::size_t>(place);
    if (i + 1 >= energy_.size())
        return closing_ * ring_density(pi / scale_, blur_radius_px_, r);
    const double t = place - static_cast<double>(i);
    const double a = intensity_[i == 0 ? 1 : i - 1], b = intensity_[i];
    const double c = intensity_[i + 1], d = intensity_[i + 2];
    const double value = b + 0.5 * t * (c - a) + 0.5 * t * t * (2.0 * a - 5.0 * b + 4.0 * c - d) +
                         0.5 * t * t * t * (3.0 * (b - c) + d - a);
    return std::max(0.0, value) * scale_ * scale_ / (4.0 * pi);
}

double WavePointSpread::energy_within(double r) const {
    const double v = scale_ * r, place = v / wave_step;
    const auto i = static_cast<std::size_t>(place);
    if (i + 1 >= energy_.size())
        return 1.0 - closing_ * 2.0 / pi * tail_shape(u_, v);
    // Hermite's cubic: the slopes are known.
    const double t = place - static_cast<double>(i);
    const double slope_a = 0.5 * static_cast<double>(i) * wave_step * wave_step * intensity_[i];
    const double slope_b =
        0.5 * static_cast<double>(i + 1) * wave_step * wave_step * intensity_[i + 1];
    const double rise = energy_[i + 1] - energy_[i];
    return energy_[i] + t * (slope_a + t * (3.0 * rise - 2.0 * slope_a - slope_b +
                                            t * (slope_a + slope_b - 2.0 * rise)));
}

double WavePointSpread::radius_of(double energy) const {
    if (energy >= energy_.back()) {  // (1 - E) pi / 2 / closing = v / (v^2 - u^2)
        const double k = (1.0 - energy) * pi / (2.0 * closing_);
        return (1.0 + std::sqrt(1.0 + 4.0 * k * k * u_ * u_)) / (2.0 * k) / scale_;
    }
    const auto after = std::upper_bound(energy_.begin(), energy_.end(), energy);
    const auto i = static_cast<double>(after - energy_.begin() - 1);
    double low = i * wave_step / scale_, high = (i + 1.0) * wave_step / scale_;
    for (int n = 0; n < 24; ++n) {
        const double middle = 0.5 * (low + high);
        (energy_within(middle) <= energy ? low : high) = middle;
    }
    return 0.5 * (low + high);
}

WaveTable::WaveTable(double lambda_n_px, double largest_blur_px)
    : lambda_n_px_(lambda_n_px), step_px_(0.1 * lambda_n_px / pi) {
    const WavePointSpread largest(lambda_n_px, largest_blur_px);  // refuses what is none
    entries_ = std::vector<Entry>(static_cast<std::size_t>(largest_blur_px / step_px_) + 2);
}

const WavePointSpread& WaveTable::entry(std::size_t i) const {
    Entry& entry = entries_[i];
    std::call_once(entry.once, [&] {
        entry.psf = std::make_unique<const WavePointSpread>(lambda_n_px_,
                                                            static_cast<double>(i) * step_px_);
    });
    return *entry.psf;
}

double WaveTable::radius_of(double energy, double blur_radius_px) const {
    const double last = static_cast<double>(entries_.size() - 1);
    const double place = std::min(blur_radius_px / step_px_, last - 1e-9);
    const auto i = static_cast<std::size_t>(place);
    const double part = place - static_cast<double>(i);
    return (1.0 - part) * entry(i).radius_of(energy) + part * entry(i + 1).radius_of(energy);
}

WaveFilter::WaveFilter(const CameraModel& camera)
    : lambda_n_px_(etalon::lambda_n_px(camera)),
      pitch_y_(camera.intrinsics.fx / camera.intrinsics.fy),
      ring_px_(std::max(1.0, 2.0 * lambda_n_px_)) {
    WavePointSpread(lambda_n_px_, max_wave_blur_px);  // refuses what is none
}

double WaveFilter::blur_step_px() const {
    return 0.25 * lambda_n_px_ / pi;  // of u: 0.25
}

double WaveFilter::core_radius_px(int index) const {
    return index * blur_step_px() + fall_to * ring_px_;
}

double WaveFilter::window(double blur_radius_px, double r) const {
    const double from = blur_radius_px + fall_from * ring_px_;
    const double t = std::clamp((r - from) / ((fall_to - fall_from) * ring_px_), 0.0, 1.0);
    return 1.0 - t * t * t * (10.0 + t * (6.0 * t - 15.0));
}

double WaveFilter::core_energy(const WavePointSpread& psf) const {
    constexpr int rings = 8000;
    const double end = psf.blur_radius_px() + fall_to * ring_px_;
    double sum = 0.0, within = 0.0;
    for (int i = 0; i < rings; ++i) {
        const double next = psf.energy_within(end * (i + 1) / rings);
        sum += window(psf.blur_radius_px(), end * (i + 0.5) / rings) * (next - within);
        within = next;
    }
    return sum;
}

const cv::Mat& WaveFilter::core(int k, int index) const {
    const std::lock_guard lock(mutex_);
    auto& slot = cores_[{k, index}];
    if (!slot)
        slot = std::make_unique<const cv::Mat>(make_core(k, index));
    return *slot;
}

cv::Size WaveFilter::core_reach(int k, int index) const {
    const auto reach = [&](double pitch) {
        return static_cast<int>(std::ceil((core_radius_px(index) / pitch + 0.5) * k)) + 3;
    };
    return {reach(1.0), reach(pitch_y_)};
}

cv::Mat WaveFilter::make_core(int k, int index) const {
    const WavePointSpread psf(lambda_n_px_, index * blur_step_px());
    const cv::Size reach = core_reach(k, index);
    const double half = core_radius_px(index);
    const double step = std::min(std::max(lambda_n_px_ / 8.0, 1.0 / 256.0), 1.0 / (8.0 * k));
    const Nodes x = nodes(half, step, 1.0, k, 2 * reach.width + k);
    const Nodes y = nodes(half, step, pitch_y_, k, 2 * reach.height + k);
    const Eigen::Index n = x.position.size();
    Eigen::MatrixXd values(n, n);
    for (Eigen::Index j = 0; j < n / 2; ++j)
        for (Eigen::Index i = 0; i <= j; ++i) {
            const double r = std::hypot(x.position[i], x.position[j]);
            const double value = psf.density(r) * window(psf.blur_radius_px(), r);
            for (const auto& [a, b] : {std::pair{i, j}, {j, i}})
                values(a, b) = values(n - 1 - a, b) = values(a, n - 1 - b) =
                    values(n - 1 - a, n - 1 - b) = value;
        }
    const Eigen::MatrixXd weights = y.response.transpose() * (values * x.response);
    const double scale = core_energy(psf) / weights.sum();
    cv::Mat result(static_cast<int>(weights.rows()), static_cast<int>(weights.cols()), CV_32FC1);
    for (int row = 0; row < result.rows; ++row)
        for (int column = 0; column < result.cols; ++column)
            result.at<float>(row, column) = static_cast<float>(weights(row, column) * scale);
    return result;
}

// The mean over the rings misses a little of the rings' energy where the tail begins: made up by
// the factor.
cv::Mat WaveFilter::tail(double blur_radius_px, const cv::Size& half) const {
    const double begin = blur_radius_px + fall_from * ring_px_;
    const auto density = [&](double r) {
        return r <= begin ? 0.0
                          : ring_density(lambda_n_px_, blur_radius_px, r) *
                                (1.0 - window(blur_radius_px, r));
    };
    const double end = blur_radius_px + fall_to * ring_px_;
    constexpr int rings = 2000;
    double energy = 2.0 * lambda_n_px_ * end /
                    (pi * pi * (end * end - blur_radius_px * blur_radius_px));  // beyond `end`
    for (int i = 0; i < rings; ++i) {
        const double r = begin + (end - begin) * (i + 0.5) / rings;
        energy += density(r) * 2.0 * pi * r * (end - begin) / rings;
    }
    const WavePointSpread psf(lambda_n_px_, blur_radius_px);
    const double factor = (1.0 - core_energy(psf)) / energy * pitch_y_;
    cv::Mat kernel(2 * half.height + 1, 2 * half.width + 1, CV_32FC1);
    for (int y = -half.height; y <= half.height; ++y)
        for (int x = -half.width; x <= half.width; ++x)
            kernel.at<float>(y + half.height, x + half.width) =
                static_cast<float>(factor * density(std::hypot(x, y * pitch_y_)));
    return kernel;
}

}  // namespace etalon
