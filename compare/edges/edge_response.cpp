#include "compare/edges/edge_response.h"

#include <fmt/format.h>
#include <math.h>  // j1, jn: POSIX, not in namespace std

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/program/errors.h"

namespace etalon {
namespace {

using std::numbers::pi;

double sinc(double x) {
    const double q = pi * x;
    return std::abs(q) < 1e-6 ? 1.0 : std::sin(q) / q;
}

// Gauss and Legendre's rule with 8 points on [-1, 1], the positive half.
constexpr std::array<std::pair<double, double>, 4> gauss_legendre_8 = {
    {{0.1834346424956498, 0.3626837833783620},
     {0.5255324099163290, 0.3137066458778873},
     {0.7966664774136267, 0.2223810344533745},
     {0.9602898564975363, 0.1012285362903763}}};

struct Cell {
    Eigen::Index index;
    double part, sign;
};

Cell cell_of(double distance_px, Eigen::Index size) {
    const double position =
        std::min(std::abs(distance_px) / EdgeResponse::step(), static_cast<double>(size - 1));
    const auto index = std::min(static_cast<Eigen::Index>(position), size - 2);
    return {index, position - static_cast<double>(index), distance_px < 0.0 ? -1.0 : 1.0};
}

}  // namespace

Eigen::ArrayXd pixel_transfer(const Eigen::ArrayXd& cycles_per_px, const Eigen::Vector2d& normal) {
    return cycles_per_px.unaryExpr(
        [&](double f) { return sinc(f * normal.x()) * sinc(f * normal.y()); });
}

// d/d(r^2) of 2 J1(q)/q with dq/d(r^2) = q / (2 r^2): -J2(q) / r^2 = -(2 pi f)^2 J2(q) / q^2.
DiskTransfer disk_transfer(double frequency, double radius) {
    const double k = 2.0 * pi * frequency, q = k * radius;
    if (q < 1e-2)  // 1 - q^2/8 + q^4/192, and its derivative
        return {1.0 - q * q / 8.0 + q * q * q * q / 192.0, -k * k * (1.0 / 8.0 - q * q / 96.0)};
    return {2.0 * ::j1(q) / q, -k * k * ::jn(2, q) / (q * q)};
}

AiryTransfer airy_transfer(double f_lambda_n) {
    if (f_lambda_n >= 1.0)
        return {0.0, 0.0};
    const double root = std::sqrt(1.0 - f_lambda_n * f_lambda_n);
    return {2.0 / pi * (std::acos(f_lambda_n) - f_lambda_n * root), -4.0 / pi * root};
}

// A panel of 8 points spans at most one cycle of the fastest oscillation.
EdgeResponse::EdgeResponse(double reach_px) {
    if (!(reach_px > 0.0 && reach_px <= 100.0))
        throw NumericalError(fmt::format("no edge profile reaches {} px", reach_px));
    const auto panels = static_cast<Eigen::Index>(std::ceil(max_frequency * reach_px)) + 4;
    const double width = max_frequency / static_cast<double>(panels);
    frequencies_.resize(8 * panels);
    Eigen::ArrayXd weights(8 * panels);
    for (Eigen::Index panel = 0; panel < panels; ++panel)
        for (Eigen::Index i = 0; i < 8; ++i) {
            const auto& [node, weight] = gauss_legendre_8[static_cast<std::size_t>(i / 2)];
            const double centre = (static_cast<double>(panel) + 0.5) * width;
            frequencies_[8 * panel + i] = centre + 0.5 * width * (i % 2 == 0 ? node : -node);
            weights[8 * panel + i] = 0.5 * width * weight;
        }
    const auto distances = static_cast<Eigen::Index>(std::ceil(reach_px / step())) + 2;
    sines_.resize(distances, frequencies_.size());
    cosines_.resize(distances, frequencies_.size());
    for (Eigen::Index i = 0; i < distances; ++i) {
        const Eigen::ArrayXd phase = 2.0 * pi * static_cast<double>(i) * step() * frequencies_;
        sines_.row(i) = weights * phase.sin() / (pi * frequencies_);
        cosines_.row(i) = 2.0 * weights * phase.cos();
    }
}

EdgeValue edge_value(const Eigen::ArrayXd& odd, const Eigen::ArrayXd& even, double distance_px) {
    const auto [i, t, sign] = cell_of(distance_px, odd.size());
    const double a = odd[i], b = odd[i + 1], h = EdgeResponse::step();
    const double slope_a = h * even[i], slope_b = h * even[i + 1];
    const double cubic = 2.0 * (a - b) + slope_a + slope_b;
    const double square = 3.0 * (b - a) - 2.0 * slope_a - slope_b;
    const double value = a + t * (slope_a + t * (square + t * cubic));
    return {0.5 + sign * value, even[i] + t * (even[i + 1] - even[i])};
}

double odd_at(const Eigen::ArrayXd& odd, double distance_px) {
    const auto [i, t, sign] = cell_of(distance_px, odd.size());
    return sign * (odd[i] + t * (odd[i + 1] - odd[i]));
}

}  // namespace etalon
