#include "sim/psf/wedge_table.h"

#include <cmath>

namespace etalon {
namespace {

constexpr double per_unit = 256.0;

double sinc(double x) {
    const double phase = std::numbers::pi * x;
    return std::abs(phase) < 1e-6 ? 1.0 : std::sin(phase) / phase;
}

double sinc_slope(double x) {
    return std::abs(x) < 1e-3 ? -std::numbers::pi * std::numbers::pi / 3.0 * x
                              : (std::cos(std::numbers::pi * x) - sinc(x)) / x;
}

double place_of_distance(double d) {
    return per_unit * d / (1.0 + d);
}

// Cubic through values at whole places; 0 from the last but two on.
double cubic_at(const Eigen::VectorXd& values, double place) {
    const auto n = static_cast<Eigen::Index>(place);
    if (n + 2 >= values.size())
        return 0.0;
    const Eigen::Index from = std::max<Eigen::Index>(n - 1, 0);
    return cubic_through(&values[from], place - static_cast<double>(from) - 1.0);
}

// The first two nodes lie on a parabola.
double transfer_at_zero(const std::vector<RadialWave>& core) {
    const double f = core[0].cycles_per_px * core[0].cycles_per_px;
    const double g = core[1].cycles_per_px * core[1].cycles_per_px;
    return (core[0].transfer * g - core[1].transfer * f) / (g - f);
}

double row_of_blur(double blur_px) {
    return WedgeTable::rows_per_px *
           (std::hypot(blur_px, WedgeTable::even_px) - WedgeTable::even_px);
}

double blur_of_row(int row) {
    const double root = WedgeTable::even_px + static_cast<double>(row) / WedgeTable::rows_per_px;
    return std::sqrt(root * root - WedgeTable::even_px * WedgeTable::even_px);
}

}  // namespace

bool WedgeTable::suits(const PointSpreadFunction& spread, double core_px) {
    constexpr double narrowest_px = 0.2, widest_px = 5.0;
    return spread.has_cutoff() && cutoff_per_px(spread) * narrowest_px <= 1.0 &&
           core_px <= widest_px;
}

double WedgeTable::end_px(double core_px) {
    return core_px + largest_blur_px + std::numbers::sqrt2 / 2.0;
}

WedgeTable::WedgeTable(const std::vector<RadialWave>& core, double core_px)
    : frequencies_(std::ssize(core)), amplitudes_(std::ssize(core)) {
    const double energy = transfer_at_zero(core);
    for (std::size_t i = 0; i < core.size(); ++i) {
        frequencies_[static_cast<Eigen::Index>(i)] = core[i].cycles_per_px;
        amplitudes_[static_cast<Eigen::Index>(i)] = core[i].transfer * core[i].width / energy;
    }
    const auto count = static_cast<Eigen::Index>(std::ceil(place_of_distance(end_px(core_px)))) + 2;
    distances_ = Eigen::ArrayXd::LinSpaced(count, 0.0, static_cast<double>(count - 1));
    distances_ = distances_ / (per_unit - distances_);
    const Eigen::MatrixXd phases =
        2.0 * std::numbers::pi * distances_.matrix() * frequencies_.matrix().transpose();
    sines_ = phases.array().sin();
    cosines_ = phases.array().cos();
    bessels_ = phases.unaryExpr([](double phase) { return j1(phase); });
    waves_ = phases.unaryExpr([](double phase) { return j0(phase); });
    pixels_.resize(frequencies_.size(), directions + 1);
    turned_pixels_.resizeLike(pixels_);
    for (int n = 0; n <= directions; ++n) {
        const double angle = 0.25 * std::numbers::pi * n / directions;
        const double c = std::cos(angle), s = std::sin(angle);
        pixels_.col(n) =
            frequencies_.unaryExpr([&](double f) { return sinc(f * c) * sinc(f * s); });
        turned_pixels_.col(n) = frequencies_.unaryExpr([&](double f) {
            return c * sinc(f * c) * sinc_slope(f * s) - s * sinc_slope(f * c) * sinc(f * s);
        });
    }
    const auto values = static_cast<std::size_t>(row_count * count);
    edges_ = std::make_unique_for_overwrite<float[]>(values * (directions + 1));
    turns_ = std::make_unique_for_overwrite<float[]>(values * (directions + 1));
    wedges_ = std::make_unique_for_overwrite<float[]>(values * wedge_values);
    const float* diagonal = rows(0.0, 0.0).edges + directions * count;
    for (Eigen::Index n = 0; n < count; ++n)
        if (diagonal[n] > negligible)
            sharp_reach_px_ = distances_[n];
}

WedgeRows WedgeTable::rows(double least_blur_px, double largest_blur_px) const {
    const int first = std::clamp(static_cast<int>(row_of_blur(least_blur_px)), 0, row_count - 2);
    const int last =
        std::clamp(static_cast<int>(row_of_blur(largest_blur_px)), first, row_count - 2) + 1;
    for (int row = first; row <= last; ++row)
        std::call_once(made_[static_cast<std::size_t>(row)], [&] { make(row); });
    return {edges_.get(),
            turns_.get(),
            wedges_.get(),
            static_cast<int>(distances_.size()),
            static_cast<float>(per_unit),
            static_cast<float>(first),
            static_cast<float>(last)};
}

void WedgeTable::make(int row) const {
    const double blur_px = blur_of_row(row);
    const Eigen::ArrayXd amplitudes =
        amplitudes_ * frequencies_.unaryExpr([&](double f) { return disk_transfer(blur_px * f); });
    const Eigen::VectorXd lines = amplitudes / (std::numbers::pi * frequencies_);
    const auto before = static_cast<std::size_t>(row * distances_.size());
    const auto put = [&](Eigen::MatrixXd values, float* to) {
        values.bottomRows(2).setZero();
        Eigen::Map<Eigen::MatrixXf>(to, values.rows(), values.cols()) = values.cast<float>();
    };
    Eigen::MatrixXd beyond = -sines_ * (lines.asDiagonal() * pixels_);
    beyond.array() += 0.5;
    put(beyond, &edges_[before * (directions + 1)]);
    put(cosines_ * (lines.asDiagonal() * turned_pixels_) / (-2.0 * std::numbers::pi),
        &turns_[before * (directions + 1)]);
    make_wedges(amplitudes, lines, &wedges_[before * wedge_values]);
    make_densities(blur_px, &wedges_[before * wedge_values + angles + 1]);
}

void WedgeTable::make_wedges(const Eigen::ArrayXd& amplitudes, const Eigen::VectorXd& lines,
                             float* to) const {
    using std::numbers::pi;
    const Eigen::VectorXd within =
        2.0 * pi * distances_.matrix().cwiseProduct(bessels_ * amplitudes.matrix());
    const Eigen::VectorXd outside = 1.0 - within.array();
    const Eigen::VectorXd half_beyond = 0.25 - 0.5 * (sines_ * lines).array();
    constexpr double step = 0.5 * pi / angles;
    for (Eigen::Index n = 0; n < distances_.size(); ++n, to += wedge_values) {
        const bool is_beyond = n + 2 >= distances_.size();
        double sum = 0.0;
        for (int i = 0; i < angles; ++i) {
            to[i] = static_cast<float>(sum);
            for (const double gauss : {-0.5, 0.5}) {
                const double angle = (i + 0.5 + gauss / std::sqrt(3.0)) * step;
                const double place = place_of_distance(distances_[n] / std::cos(angle));
                sum += is_beyond ? 0.0 : step / (4.0 * pi) * cubic_at(outside, place);
            }
        }
        to[angles] = is_beyond ? 0.0f : static_cast<float>(half_beyond[n]);
    }
}

void WedgeTable::make_densities(double blur_px, float* to) const {
    const double two_pi = 2.0 * std::numbers::pi;
    const Eigen::ArrayXd paraboloid = frequencies_.unaryExpr([&](double f) {
        const double q = two_pi * blur_px * f;
        return q < 1e-3 ? 1.0 : 8.0 * jn(2, q) / (q * q);
    });
    Eigen::VectorXd density = waves_ * (two_pi * amplitudes_ * frequencies_ * paraboloid).matrix();
    density.tail(2).setZero();
    for (Eigen::Index n = 0; n < density.size(); ++n)
        to[n * wedge_values] = static_cast<float>(density[n]);
}

}  // namespace etalon
